"""`python -m zoo.correct`: what is asked and kept, the rounds, and what it says to a mistake."""

import csv
import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from omegaconf import OmegaConf

from datamodules.errors import InputError
from datamodules.recording import read_recordings
from tests.recordings import Written
from tests.zoo.commands import only_line, run
from zoo.checkpoints.checkpoint import load_checkpoint, read_checkpoint_file
from zoo.cli.compose import compose_config
from zoo.correct.__main__ import command
from zoo.drives.drive_log import DriveWriter
from zoo.drives.drive_record import PERSON, DriveRow
from zoo.training.run import run_experiment

# A few seconds of the lake, every frame of which is asked about.
SHORT = ("drives=1", "seeds=1", "workers=1", "epochs=1", "speed=25", "off_m=0")
LAPS = "laps=0.02"


@pytest.fixture(scope="module")
def checkpoint(recorded: Written, tmp_path_factory: pytest.TempPathFactory) -> str:
    """A run's of the smallest network, hardly trained."""
    folder = tmp_path_factory.mktemp("run")
    overrides = [
        "model=tiny",
        "callbacks=checkpoints",
        "score=none",
        "logger=csv",
        f"data.root={recorded.folder}",
        "data.block_s=0.5",
        "data.gap_s=0.1",
        "data.batch_size=16",
        "data.cache=null",
        "trainer.max_epochs=1",
        "trainer.accelerator=cpu",
    ]
    run_experiment(OmegaConf.create(compose_config(overrides)), folder)
    return str(folder / "checkpoints" / "best.ckpt")


@pytest.fixture(scope="module")
def corrected(checkpoint: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a round of corrections; read it, never change it."""
    folder = tmp_path_factory.mktemp("corrected") / "out=1"
    command([checkpoint, *SHORT, LAPS, "rounds=1", f"out={folder}"])
    return folder


def rounds_of(folder: Path) -> list[dict]:
    return json.loads((folder / "correct.json").read_text())["rounds"]


def test_a_round_leaves_its_recording_run_checkpoint_and_score(corrected: Path) -> None:
    before, after = rounds_of(corrected)
    assert [before["corrections"], after["corrections"] > 20] == [0, True]
    recording = read_recordings(str(corrected / "round-1" / "recording"))
    assert len(recording) == after["corrections"]
    assert all(path is not None for path in recording.images.flat), "three cameras"
    assert load_checkpoint(after["checkpoint"]).config["trainer"]["max_epochs"] == 1
    for one in (before, after):
        assert set(one["tracks"]) == {"lake"}
        assert len(one["tracks"]["lake"]["autonomy"]) == 2
        assert (corrected / f"round-{one['number']}" / "drives" / "lake-0" / "drive.csv").is_file()
    run_folder = corrected / "round-1" / "run"
    assert json.loads((run_folder / "metrics.json").read_text())["drive"] is None
    assert (run_folder / ".hydra" / "config.yaml").is_file()


def test_it_trains_on_with_the_weights_and_the_split_of_before(
    corrected: Path, checkpoint: str, recorded: Written
) -> None:
    config = load_checkpoint(rounds_of(corrected)[1]["checkpoint"]).config
    assert config["data"]["root"] == [
        str(recorded.folder),
        str(corrected / "round-1" / "recording"),
    ]
    assert config["data"]["weights"] == [1.0, 4.0]
    assert config["model"]["weights"] == checkpoint
    own = load_checkpoint(checkpoint).config
    for key in ("optim", "augment"):
        assert config.get(key) == own.get(key)

    def parts(path: Path) -> dict[str, str]:
        with path.open(newline="") as file:
            return {row["image"]: row["part"] for row in csv.DictReader(file)}

    run_folder = Path(checkpoint).parent.parent
    mine = parts(corrected / "round-1" / "run" / "split.csv")
    assert {name: mine.pop(name) for name in parts(run_folder / "split.csv")} == parts(
        run_folder / "split.csv"
    )
    assert set(mine.values()) == {"train"}
    assert len(mine) == rounds_of(corrected)[1]["corrections"]


def test_the_last_epochs_weights_are_kept(corrected: Path) -> None:
    """Validation rows of the old recording do not choose among weights that learn new things."""
    checkpoints = corrected / "round-1" / "run" / "checkpoints"
    best, last = (read_checkpoint_file(checkpoints / f"{name}.ckpt") for name in ("best", "last"))
    for name, tensor in best["state_dict"].items():
        assert tensor.equal(last["state_dict"][name])


def test_the_same_command_goes_on_after_the_last_finished_round(
    corrected: Path, checkpoint: str, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    folder = tmp_path / "out"
    shutil.copytree(corrected, folder)
    first = folder / "round-1" / "run" / "checkpoints" / "last.ckpt"
    trained = first.stat().st_mtime_ns
    whole = rounds_of(folder)
    # As if it had been killed while it scored: recorded and trained, but not kept.
    state = json.loads((folder / "correct.json").read_text())
    (folder / "correct.json").write_text(json.dumps(state | {"rounds": whole[:1]}))
    capsys.readouterr()

    command([checkpoint, *SHORT, LAPS, "rounds=2", f"out={folder}"])
    printed = capsys.readouterr().out
    assert "goes on after round 0" in printed
    assert first.stat().st_mtime_ns == trained, "it was trained twice"
    assert [one["number"] for one in rounds_of(folder)] == [0, 1, 2]
    again = rounds_of(folder)[1]
    for figure in ("autonomy", "cte_mean_m"):
        assert again["tracks"]["lake"][figure] == whole[1]["tracks"]["lake"][figure]
    config = load_checkpoint(rounds_of(folder)[2]["checkpoint"]).config
    assert len(config["data"]["root"]) == 3, "its own recording and both rounds' corrections"
    names = [
        {Path(image).name for image in read_recordings(root).images[:, 0]}
        for root in config["data"]["root"]
    ]
    assert not names[1] & names[2]
    assert printed.rstrip().endswith(".ckpt")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["weight=2"], "was begun with weight=4.0"),
        (["optim.lr=0.1"], "was begun with no overrides"),
    ],
)
def test_a_folder_goes_on_with_its_own_options_only(
    arguments: list[str], said: str, corrected: Path, checkpoint: str
) -> None:
    with pytest.raises(InputError, match=said):
        command([checkpoint, *SHORT, LAPS, "rounds=1", *arguments, f"out={corrected}"])


def test_what_drives_well_is_left_alone(
    checkpoint: str, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    """Six metres straight on: nobody needs to intervene."""
    command([checkpoint, *SHORT, "laps=0.005", "enough_m=5", f"out={tmp_path / 'out'}"])
    printed = capsys.readouterr().out
    assert "that is enough" in printed
    assert len(rounds_of(tmp_path / "out")) == 1
    assert printed.rstrip().endswith(checkpoint)


# What a person corrects.


@pytest.fixture
def overridden(recorded: Written, tmp_path: Path) -> Path:
    """A recorded drive in which a person took over at 4 s and, with no picture since, at 4.3 s."""
    folder = tmp_path / "drive"
    shutil.copytree(recorded.folder / "IMG", folder / "IMG")
    writer = DriveWriter(folder)
    for number in range(70):
        person = 60 <= number < 63 or number >= 65
        writer.add(
            [
                DriveRow(
                    time_s=number / 15,
                    driver=PERSON if person else "policy",
                    frame="" if number >= 60 else f"IMG/{recorded.image(number).name}",
                    steering=0.0 if person else -0.25,
                    throttle=0.2,
                    speed_mph=20.0,
                    intervention=number in (60, 65),
                )
            ]
        )
    writer.close()
    return folder


def test_a_person_fills_in_what_a_drive_does_not_tell(
    overridden: Path, checkpoint: str, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    arguments = [checkpoint, *SHORT, LAPS, f"drive={overridden}", "before_s=1", f"out={out}"]
    with pytest.raises(InputError, match=r"labels.csv: write what should have been steered"):
        command(arguments)
    with pytest.raises(InputError, match=r"its steering column is empty"):
        command(arguments)
    with (out / "labels.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["override"] for row in rows] == ["1"] * 2
    assert [row["sent"] for row in rows] == ["-0.250"] * 2
    assert cv2.imread(str(out / "labels.png")) is not None
    for row, steering in zip(rows, ("0.1", "0,5"), strict=True):
        row["steering"] = steering
    with (out / "labels.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    command(arguments)
    recording = read_recordings(str(out / "round-1" / "recording"))
    assert recording.steering[[0, -1]].tolist() == [0.1, 0.5]
    assert (np.diff(recording.steering) > 0).all(), "interpolated between the two"
    assert len(recording) == 9
    assert len(rounds_of(out)) == 2


def test_a_persons_recording_is_trained_on_under_other_names(
    recorded: Written, checkpoint: str, tmp_path: Path
) -> None:
    """It holds the same file names as the checkpoint's own, as recordings of ours may."""
    command([checkpoint, *SHORT, LAPS, f"recording={recorded.folder}", f"out={tmp_path / 'out'}"])
    recording = read_recordings(str(tmp_path / "out" / "round-1" / "recording"))
    assert recording.steering.tolist() == recorded.steering.tolist()
    assert recording.time_s.tolist() == recorded.time_s.tolist()
    assert rounds_of(tmp_path / "out")[1]["corrections"] == 120


# Mistakes.


@pytest.mark.parametrize(
    ("option", "said"),
    [
        ("track=nowhere", "nowhere"),
        ("rounds=0", "rounds=0: must be a whole number in 1..100"),
        ("beta=2", "beta=2: must be a number in 0..1"),
        ("off_m=-1", "off_m=-1: must be a number of 0 or more, or null"),
        ("weather=hail", "weather=hail"),
        ("throttle=network", "this network gives no throttle"),
        ("throttle=none", "throttle=none: must be hold or network"),
        ("rouds=2", "did you mean rounds?"),
        ("data.rooot=x", "data.rooot: the checkpoint's config has no such key"),
        ("data.root=nowhere", "say where it is now with data.root=FOLDER"),
        ("drive=nowhere", "nowhere: holds no drive.csv"),
        ("recording=nowhere", "nowhere: no such folder"),
    ],
)
def test_a_mistake_is_one_line_before_anything_is_written(
    option: str, said: str, checkpoint: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError) as error:
        command([checkpoint, option, f"out={tmp_path / 'out'}"])
    assert said in str(error.value)
    assert not (tmp_path / "out").exists()


def test_a_network_of_another_format_cannot_be_trained_on(tmp_path: Path) -> None:
    (tmp_path / "model.onnx").write_bytes(b"any")
    with pytest.raises(InputError, match=r"model\.onnx: cannot be trained on"):
        command([str(tmp_path / "model.onnx")])


def test_no_checkpoint_is_said_in_one_line(tmp_path: Path) -> None:
    line = only_line(run(tmp_path, "nowhere.ckpt", module="zoo.correct"))
    assert "nowhere.ckpt: no such checkpoint" in line
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_holds_something_else_is_kept(checkpoint: str, tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(InputError, match=r"is not empty, and holds no correct\.json"):
        command([checkpoint, f"out={tmp_path}"])
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


def test_a_drive_without_overrides_or_pictures_has_nothing_to_correct(
    checkpoint: str, tmp_path: Path
) -> None:
    writer = DriveWriter(tmp_path / "calm")
    writer.add([DriveRow(time_s=1.0)])
    writer.close()
    with pytest.raises(InputError, match="nobody took over"):
        command([checkpoint, f"drive={tmp_path / 'calm'}"])
    writer = DriveWriter(tmp_path / "blind")
    writer.add([DriveRow(time_s=1.0), DriveRow(time_s=1.1, driver=PERSON, intervention=True)])
    writer.close()
    with pytest.raises(InputError, match=r"pictures were not kept.*drive.record=FOLDER"):
        command([checkpoint, f"drive={tmp_path / 'blind'}"])


def test_help_lists_every_option(capsys: pytest.CaptureFixture) -> None:
    command(["--help"])
    printed = capsys.readouterr().out
    for key in ("track=lake", "rounds=3", "beta=0.0", "weight=4.0", "drive=null", "off_m=1.0"):
        assert key in printed

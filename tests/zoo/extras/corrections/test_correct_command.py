"""`drivezoo correct`: an expert's labels, rounds of correction, and the file that keeps them."""

import csv
import json
import re
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import cv2
import numpy as np
import pytest
import torch
from omegaconf import OmegaConf

from datamodules.image import read_image
from datamodules.recorded_car import write_rig_of
from datamodules.recording_format import read_recordings
from datamodules.stretches import missing_rows
from tests.contracts.test_policies import check_wrapper, of_model
from tests.datamodules.exchange.test_tub import write_tub
from tests.hostile.test_saved_configs import change, listed
from tests.recordings import Written
from tests.refusals import refusal
from tests.zoo.bomb import Bomb
from tests.zoo.command_runs import run_here, succeed
from tests.zoo.simulator.tracks import loop
from tests.zoo.training.test_other_car import check_no_track_is_driven
from tests.zoo.trainings import SMALL
from zoo.base.compose import compose_config
from zoo.base.errors import InputError, StoppedError
from zoo.base.key_values import read_options
from zoo.base.rig import UDACITY
from zoo.checkpoints.checkpoint import load_checkpoint, read_checkpoint_file
from zoo.checkpoints.checkpoint_path import STARTED_IN
from zoo.checkpoints.policy_base import as_policy
from zoo.commands.convert import convert
from zoo.driving.drive_log import write_drive
from zoo.driving.drive_loop import drive
from zoo.driving.drive_record import PERSON, Drive, DriveRow
from zoo.driving.embedded_world import EmbeddedWorld, open_embedded
from zoo.driving.run_drives import all_drives
from zoo.driving.scenario import Scenario
from zoo.extras.corrections.collecting import (
    Labelled,
    LabellingPolicy,
    RecordedErrors,
    worth_keeping,
)
from zoo.extras.corrections.correct import correct
from zoo.extras.corrections.correct_options import CorrectOptions
from zoo.extras.corrections.correct_training import for_own_roots, own_config, own_roots
from zoo.extras.corrections.correction import open_progress, save
from zoo.extras.corrections.person_corrections import ask_person, corrections_of_a_person
from zoo.simulator.recorder import JPEG_QUALITY
from zoo.simulator.simulated_world import World
from zoo.simulator.weather import CLEAR
from zoo.training.run import run_experiment

# A few seconds of the lake, with a label for every frame.
PERSON_SHORT = ("seeds=1", "workers=1", "epochs=1", "speed=25")
SHORT = ("drives=1", "off_m=0", *PERSON_SHORT)
LAPS = "laps=0.02"
MODULE = "zoo.extras.corrections.correct"


@pytest.fixture(scope="module", autouse=True)
def _no_plots() -> Iterator[None]:
    """Let scores draw no plots of their drives, which take a quarter of a round's time."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setattr("zoo.scoring.track_scores.save_figure", lambda *_: None)
        yield


@pytest.fixture(scope="module")
def checkpoint(recorded: Written, tmp_path_factory: pytest.TempPathFactory) -> str:
    """Train the smallest network for an epoch, and return its checkpoint."""
    folder = tmp_path_factory.mktemp("run")
    more = [f"data.root={recorded.folder}", "data.cache=null", "logger=csv"]
    more += ["schedule=cosine", "schedule.T_max=9", "trainer.accelerator=cpu"]
    overrides = [*SMALL, *more, "trainer.max_epochs=1", "quick=true", "quick_samples=300"]
    run_experiment(OmegaConf.create(compose_config(overrides)), folder)
    return str(folder / "checkpoints" / "best.ckpt")


@pytest.fixture(scope="module")
def corrected(checkpoint: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of one round of corrections, which tests must not change."""
    folder = tmp_path_factory.mktemp("corrected") / "out=1"
    correct.main([checkpoint, *SHORT, LAPS, "rounds=1", f"out={folder}"])
    return folder


def rounds_of(folder: Path) -> list[dict]:
    return json.loads((folder / "correct.json").read_text())["rounds"]


def test_a_round_leaves_its_recording_run_checkpoint_and_score(corrected: Path) -> None:
    before, after = rounds_of(corrected)
    assert [before["corrections"], after["corrections"] > 20] == [0, True]
    recording = read_recordings(str(corrected / "round-1" / "recording"))
    assert len(recording) == after["corrections"]
    assert all(path is not None for path in recording.images.flat), "three cameras"
    config = load_checkpoint(after["checkpoint"]).config
    assert config["trainer"]["max_epochs"] == config["schedule"]["T_max"] == 1
    for row in (before, after):
        assert set(row["tracks"]) == {"lake"}
        assert len(row["tracks"]["lake"]["autonomy"]) == 2
        assert (corrected / f"round-{row['number']}" / "drives" / "lake-0" / "drive.csv").is_file()
    run_folder = corrected / "round-1" / "run"
    assert json.loads((run_folder / "metrics.json").read_text())["drive"] is None
    assert (run_folder / ".hydra" / "config.yaml").is_file()


def test_a_round_continues_a_training(corrected: Path, checkpoint: str, recorded: Written) -> None:
    config = load_checkpoint(rounds_of(corrected)[1]["checkpoint"]).config
    assert config["data"]["root"] == [str(recorded.folder), f"{corrected}/round-1/recording"]
    assert config["data"]["weights"] == [1.0, 4.0]
    assert config["model"]["weights"] == checkpoint
    start = load_checkpoint(checkpoint).config
    for key in ("optim", "augment"):
        assert config.get(key) == start.get(key)

    def parts(path: Path) -> dict[str, str]:
        with path.open(newline="") as file:
            return {row["image"]: row["part"] for row in csv.DictReader(file)}

    run_folder = Path(checkpoint).parent.parent
    mine = parts(corrected / "round-1" / "run" / "split.csv")
    before = parts(run_folder / "split.csv")
    assert {name: mine.pop(name) for name in before} == before
    assert set(mine.values()) == {"train"}
    assert len(mine) == rounds_of(corrected)[1]["corrections"]


def test_the_last_epochs_weights_are_kept(corrected: Path) -> None:
    """Rows of the old recording cannot tell which weights learned the corrections best."""
    checkpoints = corrected / "round-1" / "run" / "checkpoints"
    best, last = (read_checkpoint_file(checkpoints / f"{name}.ckpt") for name in ("best", "last"))
    for name, tensor in best["state_dict"].items():
        assert tensor.equal(last["state_dict"][name])


def test_a_command_resumes_after_a_round(corrected: Path, checkpoint: str, tmp_path: Path) -> None:
    folder = tmp_path / "out"
    shutil.copytree(corrected, folder)
    first = folder / "round-1" / "run" / "checkpoints" / "last.ckpt"
    trained = first.stat().st_mtime_ns
    whole = rounds_of(folder)
    # As if killed while scoring: round 1 is recorded and trained, but not in the file.
    state = json.loads((folder / "correct.json").read_text())
    moved = whole[0] | {"checkpoint": "of another folder.ckpt"}
    (folder / "correct.json").write_text(json.dumps(state | {"rounds": [moved]}))
    options = (*SHORT, LAPS, "rounds=2", f"out={folder}")
    printed = succeed(run_here(tmp_path, checkpoint, *options, module=MODULE))
    assert "after round 0" in printed
    assert "1 epoch of 300 samples" in printed
    assert first.stat().st_mtime_ns == trained, "it was trained twice"
    assert [row["number"] for row in rounds_of(folder)] == [0, 1, 2]
    assert rounds_of(folder)[0]["checkpoint"] == checkpoint
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
    assert re.search(r"^wrote: .*\.ckpt$", printed, re.MULTILINE)
    lines = printed.splitlines()
    following = [number for number, line in enumerate(lines, 1) if line.startswith("next: ")]
    assert following == [len(lines)], "one next command, and only at the end"


def test_a_folder_resumes_only_with_its_own_options(corrected: Path, checkpoint: str) -> None:
    arguments = [checkpoint, *SHORT, LAPS, "rounds=1", f"out={corrected}"]
    for changed, text in (("weight=2", r"weight=4\.0.*out="), ("delay_s=0.2", "delay_s=0")):
        with pytest.raises(InputError, match=text):
            correct.main([*arguments, changed])
    with pytest.raises(InputError, match=r"no overrides.*out="):
        correct.main([*arguments, "optim.lr=0.1"])


@pytest.mark.parametrize("end", ["", ":3"])
def test_a_changed_road_is_not_resumed_on(checkpoint: str, tmp_path: Path, end: str) -> None:
    (tmp_path / "road.yaml").write_text("as it was")
    started = tmp_path, checkpoint, CorrectOptions(track=f"lake,{tmp_path}/road.yaml{end}"), []
    save(open_progress(*started), tmp_path)
    assert open_progress(*started)["rounds"] == []
    (tmp_path / "road.yaml").write_text("edited")
    assert re.search(r"road\.yaml=.*give the same", refusal(open_progress, *started))


def test_a_checkpoint_that_drives_well_is_not_corrected(checkpoint: str, tmp_path: Path) -> None:
    """Six metres straight on need no intervention."""
    options = (*SHORT, "laps=0.005", "enough_m=5", "out=out")
    printed = succeed(run_here(tmp_path, checkpoint, *options, module=MODULE))
    assert "enough_m=5" in printed
    assert "with 1 start seed from 0 on" in printed
    assert not re.search("no round drives|±|--help", printed), "there was no round"
    assert "next: drivezoo benchmark" in printed
    assert len(rounds_of(tmp_path / "out")) == 1
    assert not list((tmp_path / "out").rglob("*.ckpt"))


def test_the_command_that_resumes_names_the_users_parts(
    checkpoint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "zoo.extras.corrections.correction.Correction.run", Mock(side_effect=KeyboardInterrupt)
    )
    monkeypatch.setattr("sys.orig_argv", ["drivezoo", "parts=my_net.py"])
    with pytest.raises(StoppedError, match=r"rounds=2 .*parts=my_net\.py$"):
        correct.main([checkpoint, "rounds=2", f"out={tmp_path / 'out'}"])


# Corrections by a person.


@pytest.fixture
def overridden(recorded: Written, tmp_path: Path) -> Path:
    """Write a drive with takeovers at 4 s and, without an image in between, at 4.3 s."""
    folder = tmp_path / "drive"
    shutil.copytree(recorded.folder / "IMG", folder / "IMG")
    rows = []
    for number in range(70):
        person = 60 <= number < 63 or number >= 65
        row = DriveRow(
            time_s=number / 15,
            driver=PERSON if person else "policy",
            frame="" if number >= 60 else f"IMG/{recorded.image(number).name}",
            steering=0.0 if person else -0.25,
            throttle=0.2,
            speed_mph=20.0,
            intervention=number in (60, 65),
        )
        rows.append(row)
    write_drive(folder, Drive.of(rows))
    return folder


def test_a_person_fills_in_the_steering(overridden: Path, checkpoint: str, tmp_path: Path) -> None:
    out = tmp_path / "out"
    arguments = [checkpoint, *PERSON_SHORT, LAPS, f"drive={overridden}", "before_s=1", f"out={out}"]
    with pytest.raises(InputError, match=r"labels\.csv: .*last column .*interpolated"):
        correct.main(arguments)
    with pytest.raises(InputError, match=r"labels\.csv: .*steering column"):
        correct.main(arguments)
    rows = list(csv.DictReader((out / "labels.csv").read_text().splitlines()))
    assert [row["override"] for row in rows] == ["1"] * 2
    assert [row["sent"] for row in rows] == ["-0.250"] * 2
    assert cv2.imread(str(out / "labels.png")) is not None
    for row, steering in zip(rows, ("0.1", "0,5"), strict=True):
        row["steering"] = steering
    with (out / "labels.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    labels = (out / "labels.csv").read_text()
    (out / "labels.csv").write_text(labels.replace("center", "centre", 1))
    with pytest.raises(InputError, match=r"labels\.csv: 'IMG/centre.* is of no takeover"):
        correct.main(arguments)
    (out / "labels.csv").write_text(labels)
    correct.main(arguments)
    recording = read_recordings(str(out / "round-1" / "recording"))
    assert recording.steering[[0, -1]].tolist() == [0.1, 0.5]
    assert (np.diff(recording.steering) > 0).all(), "interpolated between the two"
    assert len(recording) == 9
    assert len(rounds_of(out)) == 2
    correct.main(arguments)
    (out / "labels.csv").write_text((out / "labels.csv").read_text().replace("0.1", "0.2"))
    with pytest.raises(InputError, match=r"labels\.csv: has changed since .*round-1.*out=NEW"):
        correct.main(arguments)


def test_a_persons_recording_is_renamed(recorded: Written, checkpoint: str, tmp_path: Path) -> None:
    """Two recordings of one simulator can have the same file names."""
    said = f"recording={recorded.folder}"
    correct.main([checkpoint, *PERSON_SHORT, LAPS, said, f"out={tmp_path}/out"])
    recording = read_recordings(str(tmp_path / "out" / "round-1" / "recording"))
    assert recording.steering.tolist() == recorded.steering.tolist()
    assert recording.time_s.tolist() == recorded.time_s.tolist()
    assert rounds_of(tmp_path / "out")[1]["corrections"] == 120


def test_a_persons_recording_keeps_its_car_and_its_pauses(recorded: Written, here: Path) -> None:
    shutil.copytree(recorded.folder, "own")
    write_rig_of(Path("own"), replace(UDACITY, name="mine"), "another_car")
    lines = Path("own", "driving_log.csv").read_text().splitlines(keepends=True)
    Path("own", "driving_log.csv").write_text("".join([*lines[:50], "\n", *lines[50:]]))
    assert corrections_of_a_person(CorrectOptions(recording="own"), here, here / "new") == 120
    recording = read_recordings(str(here / "new"))
    assert recording.rig.name == "mine"
    assert np.flatnonzero(missing_rows(recording)).tolist() == [49]


def test_a_drive_of_another_car_keeps_its_car(overridden: Path, tmp_path: Path) -> None:
    write_rig_of(overridden, replace(UDACITY, name="mine"), "another_car")
    options = CorrectOptions(drive=str(overridden), before_s=1)
    with pytest.raises(InputError, match="last column"):
        ask_person(options, tmp_path)
    labels = (tmp_path / "labels.csv").read_text()
    (tmp_path / "labels.csv").write_text(labels.replace("-0.250,", "-0.250,0.1"))
    assert corrections_of_a_person(options, tmp_path, tmp_path / "new") == 9
    assert read_recordings(str(tmp_path / "new")).rig.name == "mine"


def test_images_in_larger_files_are_corrections_too(recorded: Written, tmp_path: Path) -> None:
    pytest.importorskip("zoo.extras.formats.lerobot", reason="an extra reads and writes it")
    convert(recorded.folder, to="lerobot", out=tmp_path / "set")
    options = CorrectOptions(recording=str(tmp_path / "set"))
    assert corrections_of_a_person(options, tmp_path, tmp_path / "new") == 120
    recording = read_recordings(str(tmp_path / "new"))
    assert recording.steering == pytest.approx(recorded.steering, abs=1e-6)
    assert not np.isnan(recording.time_s).any()
    assert read_image(recording.images[0, 0]).shape == (160, 320, 3)


def test_what_a_config_says_of_its_recordings_is_not_said_of_corrections() -> None:
    degrees, keys = {"unit": "deg", "full": 25}, {"format": None, "speed_unit": "mps"}
    data = for_own_roots({**keys, "steering": degrees, "each": {2: {"format": "table"}}}, 2)
    second = {"steering": degrees, "format": "table"}
    assert data == {**keys, "steering": None, "each": {1: {"steering": degrees}, 2: second}}
    assert for_own_roots({**keys, "each": None}, 2) == {**keys, "each": None}


# Errors.


@pytest.mark.parametrize(
    ("option", "text"),
    [
        ("track=nowhere", "nowhere"),
        ("weather=hail", "weather=hail"),
        ("throttle=network", "throttle"),
        ("data.rooot=x", "data.rooot: "),
        ("data.root=nowhere", "data.root=FOLDER"),
        ("drive=nowhere", "nowhere: "),
        ("recording=nowhere", "nowhere: "),
        ("drive=nowhere rounds=5", "rounds=5"),
        ("recording=nowhere before_s=2", "before_s=2"),
    ],
)
def test_a_mistake_writes_nothing(option: str, text: str, checkpoint: str, tmp_path: Path) -> None:
    assert text in refusal(correct.main, [checkpoint, *option.split(), f"out={tmp_path / 'out'}"])
    assert not (tmp_path / "out").exists()


def test_no_other_format_is_trained_on(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    correct.main(["--help"])
    assert ".onnx" not in capsys.readouterr().out
    (tmp_path / "model.onnx").write_bytes(b"any")
    with pytest.raises(InputError, match=r"model\.onnx: .*exported from"):
        correct.main([str(tmp_path / "model.onnx")])


@pytest.mark.parametrize(
    ("key", "value", "refused"),
    [
        ("loss", {"_target_": "torch.load", "f": "x", "weights_only": False}, "trust=torch.load"),
        ("model.width", 1e9, "parameters"),
    ],
)
def test_a_strangers_config_chooses_no_code_and_no_size(
    key: str, value: object, refused: str, checkpoint: str, here: Path
) -> None:
    torch.save(Bomb(here / "ran"), here / "x")
    run = Path(shutil.copytree(Path(checkpoint).parents[1], here / "run"))
    change(run, key, value)
    before = listed(here)
    with pytest.raises(InputError, match=refused):
        correct.main(["run/checkpoints/last.ckpt", "out=corrected", "rounds=1"])
    assert listed(here) == before


def test_no_track_is_driven_that_the_user_does_not_name(checkpoint: str, tmp_path: Path) -> None:
    contents = torch.load(checkpoint, weights_only=True)
    contents["drivezoo"]["data"]["source"] = "my car"
    path = tmp_path / "run" / "checkpoints" / "best.ckpt"
    path.parent.mkdir(parents=True)
    torch.save(contents, path)
    check_no_track_is_driven(correct, tmp_path / "run", tmp_path)


def test_a_correction_adds_to_the_trainings_recording(checkpoint: str, tmp_path: Path) -> None:
    loaded = load_checkpoint(checkpoint)
    log = write_tub(tmp_path / "there" / "lake", [])
    config = loaded.config | {"data": loaded.config["data"] | {"root": "lake"}}
    moved = replace(loaded, config=config, data={STARTED_IN: str(log.parent)})
    assert own_roots(own_config(moved, [], "a.ckpt")) == [str(log)]


def test_a_folder_that_holds_something_else_is_kept(checkpoint: str, tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(InputError, match=r"correct\.json.*out="):
        correct.main([checkpoint, f"out={tmp_path}"])
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


def test_a_drive_without_takeovers_or_images_is_refused(checkpoint: str, tmp_path: Path) -> None:
    calm = [DriveRow(time_s=1.0)]
    blind = [*calm, DriveRow(time_s=1.1, driver=PERSON, intervention=True)]
    for name, rows, words in (("calm", calm, "takeover"), ("blind", blind, "record=FOLDER")):
        write_drive(tmp_path / name, Drive.of(rows))
        with pytest.raises(InputError, match=rf"{name}: .*{words}"):
            correct.main([checkpoint, f"drive={tmp_path / name}"])


LOOP = Scenario("loop", 1, laps=0.3)


def straight_on(frame: np.ndarray | None, speed_mph: float) -> tuple[float, None]:
    return 0.0, None


def labelling(world: EmbeddedWorld, beta: float = 0.0, nudge: float = 0.0) -> LabellingPolicy:
    return LabellingPolicy(as_policy(straight_on), world.simulated, 30.0, beta, nudge, seed=3)


def test_it_is_a_wrapper_as_all_are() -> None:
    world = open_embedded(Scenario("lake"), "none").simulated
    policy = of_model("action_chunk")
    check_wrapper(lambda inner: LabellingPolicy(inner, world, 15.0, 0.0, 0.0, seed=0), policy)


def test_the_labels_steer_back_to_the_middle() -> None:
    world = EmbeddedWorld(World(loop()))
    policy = labelling(world)
    driven = drive(policy, world, LOOP)
    assert len(policy.labels) == len(driven.rows)
    interventions = [number for number, row in enumerate(driven.rows) if row.intervention]
    assert interventions
    for number in interventions:
        (_, _, (steering, _)), error = policy.labels[number], driven.rows[number].cross_track_m
        assert steering * error < 0
        assert abs(steering) > 0.1


def test_with_beta_1_the_expert_drives() -> None:
    world, lap = EmbeddedWorld(World(loop())), Scenario("loop", 1)
    assert not drive(labelling(world, beta=1.0), world, lap).intervention.any()
    half = drive(labelling(world, beta=0.5), world, LOOP)
    assert 0.2 < np.mean([row.steering != 0 for row in half.rows]) < 0.8


def test_a_nudge_leads_off_the_line() -> None:
    scenario = Scenario("lake", laps=0.3)
    world = open_embedded(scenario, "none")

    def error(nudge: float) -> float:
        policy = labelling(world, nudge=nudge)
        policy.policy = as_policy(lambda frame, mph: (policy.expert(world.simulated)[0], None))
        return np.abs(drive(policy, world, scenario).cross_track_m).max()

    assert error(0.0) < 0.3 < error(0.5) < 3


def test_frames_around_interventions_and_far_off_are_kept() -> None:
    rows = [DriveRow(time_s=number / 10, cross_track_m=0.0) for number in range(100)]
    rows[5] = DriveRow(time_s=0.5, cross_track_m=1.5)
    rows[50] = DriveRow(time_s=5.0, cross_track_m=-4, intervention=True)
    rows[51] = DriveRow(time_s=5.0, cross_track_m=0)  # put back, at the same time
    assert np.flatnonzero(worth_keeping(rows, 1.0, 0.5, None)).tolist() == list(range(40, 55))
    assert np.flatnonzero(worth_keeping(rows, 0.0, 0.0, 1.0)).tolist() == [5, 50]
    assert worth_keeping(rows, 0.0, 0.0, 0.0).all()
    assert not worth_keeping(rows[:5], 3.0, 3.0, 1.0).any()


def test_the_frames_seen_are_recorded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen = []

    def policy(frame: np.ndarray, speed_mph: float) -> tuple[float, None]:
        seen.append(frame.copy())
        return 0.3, None

    monkeypatch.setattr("zoo.extras.corrections.collecting.load_kept", lambda _: as_policy(policy))
    options = read_options(CorrectOptions, ["off_m=0"])
    scenario = Scenario("lake", 1, laps=0.02, speed=20, weather=CLEAR, margin=1.0)
    keep = RecordedErrors(tmp_path / "recording", options, 1e6)
    (rows,) = all_drives(Labelled("any", options, 0.0), [scenario], keep)
    recording = read_recordings(str(tmp_path / "recording"))
    assert rows == len(recording) == len(seen) > 20
    for row in (0, rows // 2, rows - 1):
        bgr = cv2.cvtColor(seen[row], cv2.COLOR_RGB2BGR)
        jpeg = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1]
        assert Path(recording.images[row, 0]).read_bytes() == jpeg.tobytes()
    steps = np.diff(recording.time_s)
    assert (steps > 0).all()
    assert (steps > 5).any(), "an intervention leaves a gap"

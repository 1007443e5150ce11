"""Trainings on a recording of another car: what they are judged by."""

import json
import re
import shlex
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from datamodules.format_options import ReadOptions
from datamodules.recording_format import read_recordings
from datamodules.split import split_rows
from tests.recordings import Written, write_as, write_recording
from tests.zoo.command_runs import only_line, run, run_here, succeed
from tests.zoo.trainings import metrics
from tests.zoo.written_checkpoints import write_constant
from zoo.base.command import Command
from zoo.base.errors import InputError, UsageError
from zoo.checkpoints.checkpoint import load_checkpoint
from zoo.checkpoints.policy_base import Policy, read_as_trained
from zoo.commands.doctor import next_step
from zoo.commands.evaluate import evaluate
from zoo.scoring.drive_section import scores
from zoo.scoring.replay_score import held_out_replay
from zoo.scoring.reported_run import ReportedRun

RIG = """name: my car
camera: {size: [640, 480], vertical_fov_deg: 45, up_m: 1.4, ahead_m: 0.4}
wheelbase_m: 2.85
steering_deg: 31.7
guesses: [camera]
"""
SMALL = ("model=tiny", "trainer.max_epochs=1", "augment=[]", "callbacks.fed_batch=null")


def record(folder: Path, rows: int) -> Written:
    written = write_recording(folder / "drives", rows=rows)
    (written.folder / "rig.yaml").write_text(RIG)
    return written


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Written:
    return record(tmp_path_factory.mktemp("car"), rows=1200)


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> Written:
    """Write a recording whose whole is long enough for a replay, but no fifth of it."""
    return record(tmp_path_factory.mktemp("short"), rows=200)


@pytest.fixture(scope="module")
def trained(recorded: Written, tmp_path_factory: pytest.TempPathFactory) -> Path:
    cwd = tmp_path_factory.mktemp("trained")
    printed = succeed(run(cwd, *SMALL, f"data.root={recorded.folder}", "hydra.run.dir=run"))
    (cwd / "run" / "stdout.txt").write_text(printed)
    return cwd / "run"


def test_it_is_judged_by_a_replay_of_its_held_out_drives(trained: Path) -> None:
    figures, verdict = metrics(trained)["drive"], metrics(trained)["verdict"]
    (drive,) = figures["drives"]
    assert drive["laps"] is None
    assert 12 <= drive["driven_s"] <= 20  # a fifth of 80 s, without gaps
    assert list(figures["tracks"]) == ["replay of drives"]
    for words in ("held-out stretch", "drives", "my car", "guessed: camera"):
        assert words in figures["replayed"]
        assert words in verdict["certainty"]
    assert "replay of drives" in verdict["tracks"][0]
    commands = [shlex.split(command) for _, command in verdict["commands"]]
    assert commands[-1][1] == "replay"
    assert not any("lake" in word for command in commands for word in command)


def test_its_output_and_report_say_what_was_judged(trained: Path) -> None:
    replayed = metrics(trained)["drive"]["replayed"]
    for file in ("stdout.txt", "report/index.html", "report/report.md"):
        text = (trained / file).read_text()
        assert replayed in text
        assert "Driven in the embedded" not in text
        assert "laps of" not in text


def test_on_a_track_it_is_another_cars_network(trained: Path) -> None:
    checkpoint = str(trained / "checkpoints" / "best.ckpt")
    words = ("track=lake", "laps=0.01", "out=out")
    printed = succeed(run_here(trained, checkpoint, *words, module="zoo.commands.evaluate"))
    assert "another car's network drives lake" in printed
    assert "my car" in printed
    verdict = metrics(trained / "out")["verdict"]
    assert (verdict["level"], verdict["causes"]) == ("unknown", [])


def test_no_track_is_driven_that_the_user_does_not_name(trained: Path, tmp_path: Path) -> None:
    check_no_track_is_driven(evaluate, trained, tmp_path)


def check_no_track_is_driven(command: Command, trained: Path, tmp_path: Path) -> None:
    """Check that a command refuses a network of another car without a track."""
    checkpoint, out = str(trained / "checkpoints" / "best.ckpt"), tmp_path / "out"
    with pytest.raises(UsageError, match=r"my car.*drivezoo replay CKPT FOLDER.*name a track="):
        command.main([checkpoint, f"out={out}"])
    assert not out.exists()


def test_no_command_suggests_a_track_for_another_cars_network(trained: Path) -> None:
    checkpoint = str(trained / "checkpoints" / "best.ckpt")
    step, *_ = next_step(checkpoint, None, load_checkpoint(checkpoint).data)
    assert step == f"drivezoo replay {checkpoint} FOLDER"


def test_a_report_without_a_replay_says_why_and_suggests_one(trained: Path, tmp_path: Path) -> None:
    undriven = {"drive": None, "not_replayed": "no stretch is long enough"}
    (tmp_path / "metrics.json").write_text(json.dumps(metrics(trained) | undriven))
    with pytest.raises(InputError, match=r"no stretch is long enough.*drivezoo replay"):
        scores(ReportedRun(tmp_path))


def test_a_replay_of_another_cars_drives_says_so(short: Written, tmp_path: Path) -> None:
    foreign = write_constant(tmp_path / "checkpoints" / "best.ckpt", steering=0.0)
    words = (str(foreign), str(short.folder), "out=out")
    printed = succeed(run_here(tmp_path, *words, module="zoo.commands.replay"))
    assert "another car's network drives a replay" in printed
    assert "guessed: camera" in printed
    assert "next: drivezoo replay" in printed


@pytest.fixture(scope="module")
def unknown(short: Written, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder with a tub of an unknown car, and a run on it."""
    cwd = tmp_path_factory.mktemp("unknown")
    write_as("donkeycar", read_recordings(str(short.folder)), cwd / "tub")
    for file in ("rig.yaml", "source.json"):
        (cwd / "tub" / file).unlink()
    for catalog in (cwd / "tub").glob("*.catalog"):
        catalog.write_text(re.sub(r'"drivezoo/[^,]*, ', "", catalog.read_text()))
    blocks = ("data.block_s=0.5", "data.gap_s=0.1")
    printed = succeed(run_here(cwd, *SMALL, *blocks, "data.root=tub", "hydra.run.dir=run"))
    (cwd / "stdout.txt").write_text(printed)
    return cwd


def test_the_command_after_a_training_without_a_rig_writes_one(unknown: Path) -> None:
    *_, line, _ = (unknown / "stdout.txt").read_text().splitlines()
    program, *words = shlex.split(line.removeprefix("next: "))
    assert (program, *words[:2]) == ("drivezoo", "new", "rig")
    assert "the rig is unknown" in only_line(
        run_here(unknown, "run", "tub", module="zoo.commands.replay")
    )


@pytest.mark.parametrize("source", ["data.rig=my_car.yaml", "run/rig.yaml", "tub/rig.yaml"])
def test_a_rig_is_added_to_a_finished_run_whose_replays_are_of_its_car(
    unknown: Path, tmp_path: Path, source: str
) -> None:
    for name in ("run", "tub"):
        shutil.copytree(unknown / name, tmp_path / name)
    succeed(run_here(tmp_path, "rig", "my_car", module="zoo.commands.new"))
    path = tmp_path / "my_car.yaml"
    assert "my_car.yaml: still null: camera.size, " in only_line(
        run_here(tmp_path, "run", "tub", "data.rig=my_car.yaml", module="zoo.commands.replay")
    ), "what is not filled in is named"
    numbers = iter(["[320, 160]", "60", "1.2", "2.87", "25"])
    path.write_text(re.sub(r"\bnull\b(?= +#)", lambda _: next(numbers), path.read_text()))
    if "=" not in source:
        path.rename(tmp_path / source)
    words = ["run", "tub", "out=out"] + ([source] if "=" in source else [])
    printed = succeed(run_here(tmp_path, *words, module="zoo.commands.replay"))
    assert "rig: my_car" in printed
    assert "another car's network" not in printed
    card = load_checkpoint(tmp_path / "run" / "checkpoints" / "best.ckpt").data
    assert card["source"] == ("my_car" if source.startswith("run") else "a car of unknown make")


@pytest.mark.parametrize(
    ("split", "rig", "remedy"),
    [("random", True, "data.split=blocks"), ("blocks", False, "rig.yaml")],
)
def test_what_cannot_be_replayed_names_the_remedy(
    recorded: Written, split: str, rig: bool, remedy: str
) -> None:
    recording = read_recordings(str(recorded.folder))
    parts = split_rows(recording, split)
    with pytest.raises(InputError, match=remedy):
        held_out_replay(recording if rig else replace(recording, rig=None, rigs=()), parts, None)


def test_a_step_between_two_stretches_is_not_driven(recorded: Written) -> None:
    recording = read_recordings(str(recorded.folder))
    split = replace(split_rows(recording), val=np.arange(100, 300), test=np.arange(305, 400))
    world = held_out_replay(recording, split, None)
    assert np.flatnonzero(np.isnan(world.elapsed_s)).tolist() == [199, 294]


def test_no_track_chooses_its_checkpoint(short: Written, tmp_path: Path) -> None:
    monitored = ("callbacks=closed_loop", "callbacks.best.monitor=drive/cte_mean")
    keys = (*SMALL, *monitored, "data.block_s=0.5", "data.gap_s=0.1", f"data.root={short.folder}")
    line = only_line(run_here(tmp_path, *keys, "hydra.run.dir=run"))
    assert "another car than the recording (my car)" in line


def test_a_replay_reads_a_recording_as_in_training_unless_the_user_says_otherwise() -> None:
    trained = Policy()
    trained.config = {"data": {"root": "drives", "format": "table", "steering": "{unit: rad}"}}

    def keys(folder: str, **typed: str) -> dict:
        return read_as_trained([Policy(), trained], folder, ReadOptions(**typed))

    assert keys("drives") == {"format": "table", "steering": "{unit: rad}"}
    assert keys("drives", steering="{unit: deg}") == {"format": "table", "steering": "{unit: deg}"}
    table = {"rig": "my.yaml", "format": "table", "columns": "{image: path, steering: angle}"}
    assert keys("others", **table) == table
    several = {"root": ["drives", "others"], "each": {2: {"steering": "{unit: deg}"}}}
    trained.config["data"] |= several
    assert keys("drives") == {"format": "table", "steering": "{unit: rad}"}
    assert keys("others") == {"format": "table", "steering": "{unit: deg}"}
    trained.config["data"] |= {"columns": "{image: path}", "each": {2: {"format": "udacity"}}}
    assert ("columns" in keys("drives"), "columns" in keys("others")) == (True, False)

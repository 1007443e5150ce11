"""`drivezoo simulator record` as a person runs it, and recording from Python."""

import json
import os
from pathlib import Path

import numpy as np
import pytest
from rich.progress import Progress

from datamodules.recording_format import read_recordings
from tests.zoo.command_runs import run_here
from tests.zoo.simulator.tracks import LOOP, loop, write_track
from zoo.base.errors import InputError
from zoo.base.run_command import run_command
from zoo.commands.evaluate import evaluate_or_replay
from zoo.commands.simulator import simulator
from zoo.simulator.expert import Expert, ExpertSettings
from zoo.simulator.parallel_record import ParallelRecorder, Requests
from zoo.simulator.record import RecordOptions, record, record_laps
from zoo.simulator.recorder import Recorder
from zoo.simulator.simulated_world import Start, World
from zoo.simulator.track_file import read_track


class GreyRenderer:
    """A fast stand-in for a renderer: one grey per camera and frame."""

    def set_weather(self, weather, seed):
        pass

    def frame(self, pose, camera, tick):
        return np.full((160, 320, 3), (tick % 200, len(camera), 0), np.uint8)


class ConstantDriver:
    """A driver with a constant command."""

    recording = True

    def __init__(self, steering: float, throttle: float) -> None:
        self.command = steering, throttle

    def __call__(self, world):
        return self.command


def grey_loop(direction: int = 1) -> World:
    return World(loop(), GreyRenderer(), direction=direction)


@pytest.mark.parametrize("direction", [1, -1])
def test_a_lap_becomes_a_recording(tmp_path, direction):
    world = grey_loop(direction)
    with Recorder(tmp_path) as recorder:
        driven = record(world, Expert(world.track), recorder, 1.0)
    recording = read_recordings(str(tmp_path))
    assert len(recording) == recorder.rows == driven.frames
    assert recording.steering == pytest.approx(driven.steering, abs=1e-6)
    # All bends are to the left, or to the right driven backward.
    assert np.sign(recording.steering.mean()) == -direction
    assert recording.speed_mph[-1] == pytest.approx(30, abs=2)
    assert len(driven.lap_s) == 1
    assert driven.lap_s[0] == pytest.approx(world.track.length / 13.4, abs=4)


def test_moving_away_from_the_line_is_not_recorded(tmp_path):
    world = grey_loop()
    expert = Expert(world.track, ExpertSettings(noise=1, seed=1))
    with Recorder(tmp_path) as recorder:
        driven = record(world, expert, recorder, 1.5)
    assert 0.5 * driven.frames < recorder.rows < 0.9 * driven.frames
    gaps = np.diff(read_recordings(str(tmp_path)).time_s)
    assert gaps.max() > 1
    assert np.median(gaps) == pytest.approx(1 / 15, abs=0.01)


def test_several_passes_go_into_one_folder(tmp_path, console):
    clean = RecordOptions(out=str(tmp_path / "laps"), laps=0.01, quality="simple")
    noisy = RecordOptions(out="", laps=0.01, noise=0.5, start=300, direction="backward")
    assert record_laps([clean, noisy], console) == tmp_path / "laps"
    recording = read_recordings(str(tmp_path / "laps"))
    assert np.count_nonzero(np.diff(recording.time_s) > 1) == 1
    assert len(set(recording.images.flat)) == recording.images.size
    assert f"rows        {len(recording)} " in console.file.getvalue()


@pytest.mark.parametrize("passes", [2, pytest.param(4, marks=pytest.mark.slow)])
def test_two_processes_write_the_same_files_as_one(tmp_path, console, passes):
    """A weather with noise shows that the frames' numbers and seeds are the same, too."""
    folders = []
    for jobs in (1, 2):
        common = {"out": str(tmp_path / str(jobs)), "relative": True, "jobs": jobs}
        common |= {"laps": 0.02, "quality": "simple", "weather": "random", "noise": 1}
        given = [RecordOptions(**common, seed=seed, frame_rate=5) for seed in range(passes)]
        folders.append(record_laps(given, console))
    alone, shared = (
        {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*.*")}
        for folder in folders
    )
    assert len(alone) > 3 * passes
    assert alone == shared
    recipe = json.loads(alone[Path("recipe.json")])
    assert recipe["passes"] == [{"track": "lake", "laps": 0.02}] * passes


def test_leaving_the_road_fails_with_the_place_and_keeps_the_rows(tmp_path):
    world = World(read_track("lake"), Requests("lake", "software", "simple"))
    world.reset(0, Start(40, speed_mph=20))
    with (
        Recorder(tmp_path) as recorder,
        pytest.raises(InputError, match=r"left the road, \+\d\.\d m at \d\d m of .*lake") as raised,
        ParallelRecorder(recorder, 2, Progress()) as rows,
    ):
        record(world, ConstantDriver(0.3, 1), rows, 1)
    assert len(read_recordings(str(tmp_path))) == recorder.rows == rows.rows > 5
    assert f"the first {rows.rows} rows" in str(raised.value)


def test_a_killed_process_is_named_and_the_rows_before_are_kept(tmp_path):
    class Killed:
        """A stand-in for a request whose drawing kills its process."""

        def __reduce__(self):
            return os._exit, (1,)

    with Recorder(tmp_path) as recorder:
        rows = ParallelRecorder(recorder, 2, Progress())
        rows.begin_pass()
        with pytest.raises(InputError, match=r"jobs=2: .*killed.* 0 rows"), rows:
            rows.add({"center": Killed()}, 0, 0, 0, 0, 0.0)


def test_the_bar_is_shown_until_the_last_image_is_written(tmp_path, console, monkeypatch):
    written = []

    class Bar(Progress):
        def stop(self):
            written.append(len(read_recordings(str(tmp_path / "laps"))))
            super().stop()

    monkeypatch.setattr("zoo.simulator.record.Progress", Bar)
    options = RecordOptions(out=str(tmp_path / "laps"), jobs=2, laps=0.01, quality="simple")
    folder = record_laps(options, console)
    assert written == [len(read_recordings(str(folder)))]


def test_a_driver_that_stands_fails(tmp_path):
    world = grey_loop()
    with Recorder(tmp_path) as recorder, pytest.raises(InputError, match="got stuck at"):
        record(world, ConstantDriver(0, 0), recorder, 1)


def test_the_command_records_and_prints_the_next_command(tmp_path):
    words = ("record", "laps=0.01", "out=my laps", "direction=both")
    done = run_here(tmp_path, *words, module="zoo.commands.simulator")
    assert (done.returncode, done.stderr) == (0, "")
    rows, printed = len(read_recordings(str(tmp_path / "my laps"))), done.stdout
    assert f"rows        {rows} (100% of the frames)" in printed
    assert f"images      {3 * rows}" in printed
    assert "times real time" in printed
    assert "wrote: my laps/driving_log.csv\n" in printed
    assert "experiment=first_try 'data.root=my laps'" in printed


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["record"], "out: not given; add out=VALUE"),
        (["record", "out=x", "laps=0"], "laps=0: must be a number above 0"),
        (["record", "out=x", "noise=2"], "noise=2: must be a number in 0..1"),
        (["record", "out=x", "start=inf"], "start=inf: must be a finite number"),
        (["record", "out=x", "seed=-1"], "seed=-1: must be a whole number of 0 or more"),
        (["record", "out=x", "track=laek"], "there is no track laek"),
        (["record", "out=x", "direction=up"], "direction=up: must be forward or backward or both"),
        (["record", "out=x", "control=mose"], "control=mose: must be expert, keyboard or mouse"),
        (["record", "out=x", "frame_rate=60"], "frame_rate=60: must be a number in 0.1..50"),
        (["record", "out=x", "weather=snow"], "weather=snow: must be clear, random or settings"),
        (["record", "out=x", "renderer=none"], "renderer=none: must be auto, software or opengl"),
        (["record", "out=x", "jobs=0"], "jobs=0: must be a whole number in 1..64"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_a_mistake_is_one_line_and_leaves_no_folder(tmp_path, arguments, message, capsys):
    assert run_command("drivezoo simulator", simulator, arguments) == 2
    line = capsys.readouterr().err.strip()
    assert line.startswith("drivezoo simulator: ")
    assert message in line
    assert "\n" not in line
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("command", "arguments"),
    [(simulator, ["record", "out=laps"]), (evaluate_or_replay, ["lenet", "out=laps"])],
    ids=["record", "evaluate"],
)
def test_a_wrong_value_in_a_tracks_file_is_a_failure(command, arguments, tmp_path, capsys):
    track = write_track(tmp_path, points=LOOP, width=2)
    assert run_command("drivezoo", command, [*arguments, f"track={track}"]) == 1
    assert f"{track}: width: 2; must be" in capsys.readouterr().err
    assert not (tmp_path / "laps").exists()

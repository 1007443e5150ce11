"""The expert's labels while a model drives, and the frames that are recorded with them."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from datamodules.recording_format import read_recordings
from simulator.recorder import JPEG_QUALITY
from simulator.weather import CLEAR
from simulator.world import World
from tests.simulator.tracks import loop
from zoo.base.command_keys import read_options
from zoo.checkpoints.command import as_policy
from zoo.correct.collecting import Labelled, LabellingPolicy, RecordedErrors, worth_keeping
from zoo.correct.correct_options import CorrectOptions
from zoo.drives.drive_record import DriveRow
from zoo.worlds.drive_loop import drive
from zoo.worlds.embedded_world import EmbeddedWorld, open_embedded
from zoo.worlds.run_drives import all_drives
from zoo.worlds.scenario import Scenario

LOOP = Scenario("loop", 1, laps=0.3)


def straight_on(frame: np.ndarray | None, speed_mph: float) -> tuple[float, None]:
    return 0.0, None


def labelling(world: EmbeddedWorld, beta: float = 0.0, nudge: float = 0.0) -> LabellingPolicy:
    return LabellingPolicy(as_policy(straight_on), world.simulated, 30.0, beta, nudge, seed=3)


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
    half = drive(labelling(world, beta=0.5), world, lap)
    steered = np.array([row.steering != 0 for row in half.rows])
    assert 0.2 < steered.mean() < 0.8


def test_a_nudge_leads_off_the_line() -> None:
    scenario = Scenario("lake", laps=0.3)
    world = open_embedded(scenario, "none")

    def error(nudge: float) -> float:
        policy = labelling(world, nudge=nudge)
        policy.policy = as_policy(lambda frame, mph: (policy.expert(world.simulated)[0], None))
        return np.abs(drive(policy, world, scenario).cross_track_m).max()

    assert error(0.0) < 0.3 < error(0.5) < 3


def test_frames_around_interventions_and_far_off_are_kept() -> None:
    rows = [
        DriveRow(time_s=number / 10, cross_track_m=1.5 if number == 5 else 0.0)
        for number in range(100)
    ]
    rows[50] = DriveRow(time_s=5.0, cross_track_m=-4, intervention=True)
    rows[51] = DriveRow(time_s=5.0, cross_track_m=0)  # put back, at the same time
    assert np.flatnonzero(worth_keeping(rows, 1.0, 0.5, None)).tolist() == list(range(40, 55))
    assert np.flatnonzero(worth_keeping(rows, 0.0, 0.0, 1.0)).tolist() == [5, 50]
    assert worth_keeping(rows, 0.0, 0.0, 0.0).all()
    assert not worth_keeping(rows[:5], 3.0, 3.0, 1.0).any()


def test_the_recording_has_the_frames_that_the_model_saw(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = []

    def policy(frame: np.ndarray, speed_mph: float) -> tuple[float, None]:
        seen.append(frame.copy())
        return 0.3, None

    monkeypatch.setattr("zoo.correct.collecting.load_kept", lambda _: as_policy(policy))
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

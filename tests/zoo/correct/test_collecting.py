"""The expert's labels while a model drives, and the frames that are recorded with them."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from datamodules.recording import read_recordings
from simulator.recorder import JPEG_QUALITY
from simulator.weather import CLEAR
from simulator.world import World, open_world
from tests.simulator.tracks import loop
from zoo.cli.command_config import read_options
from zoo.correct.collecting import LabellingPolicy, collect_drive, worth_keeping
from zoo.correct.correct_options import CorrectOptions
from zoo.drives.drive_record import DriveRow
from zoo.evaluate.many_drives import Setup, drive_setup


def straight_on(frame: np.ndarray | None, speed_mph: float) -> tuple[float, None]:
    return 0.0, None


def labelling(world: World, beta: float = 0.0, nudge: float = 0.0) -> LabellingPolicy:
    return LabellingPolicy(straight_on, world, 30.0, beta, nudge, seed=3)


def test_the_labels_steer_back_to_the_middle() -> None:
    world = World(loop())
    policy = labelling(world)
    drive = drive_setup(policy, world, Setup("loop", 1, laps=0.3, speed_mph=15))
    assert len(policy.labels) == len(drive.rows)
    interventions = [number for number, row in enumerate(drive.rows) if row.intervention]
    assert interventions
    for number in interventions:
        steering, error = policy.labels[number].steering, drive.rows[number].cross_track_m
        assert steering * error < 0
        assert abs(steering) > 0.1


def test_with_beta_1_the_expert_drives() -> None:
    world = World(loop())
    setup = Setup("loop", 1, laps=1, speed_mph=15)
    drive = drive_setup(labelling(world, beta=1.0), world, setup)
    assert not any(row.intervention for row in drive.rows)
    half = drive_setup(labelling(world, beta=0.5), world, setup)
    steered = np.array([row.steering != 0 for row in half.rows])
    assert 0.2 < steered.mean() < 0.8


def test_a_nudge_leads_off_the_line() -> None:
    world = open_world("lake", renderer="none")

    def error(nudge: float) -> float:
        policy = labelling(world, nudge=nudge)
        policy.policy = lambda frame, mph: (policy.expert(world)[0], None)
        drive = drive_setup(policy, world, Setup("lake", laps=0.3, speed_mph=15))
        return max(abs(row.cross_track_m) for row in drive.rows)

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

    monkeypatch.setattr("zoo.checkpoints.policy.load_policy", lambda _: policy)
    options = read_options("correct", CorrectOptions, ["off_m=0"])
    setup = Setup("lake", 1, laps=0.02, speed_mph=20, weather=CLEAR, margin_m=1.0)
    rows = collect_drive("any", setup, options, 0.0, 1e6, tmp_path / "recording")
    recording = read_recordings(str(tmp_path / "recording"))
    assert rows == len(recording) == len(seen) > 20
    for row in (0, rows // 2, rows - 1):
        bgr = cv2.cvtColor(seen[row], cv2.COLOR_RGB2BGR)
        jpeg = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1]
        assert Path(recording.images[row, 0]).read_bytes() == jpeg.tobytes()
    steps = np.diff(recording.time_s)
    assert (steps > 0).all()
    assert (steps > 5).any(), "an intervention leaves a gap"

"""Replays of a recording: the virtual car, its interventions, and bad recordings."""

import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from datamodules.recorded_car import other_car
from datamodules.recording_format import read_recordings
from tests.recordings import write_recording
from tests.zoo.command_runs import only_line, run_here, succeed
from tests.zoo.written_checkpoints import write_constant
from zoo.base.errors import InputError
from zoo.base.rig import MPS_PER_MPH, UDACITY
from zoo.driving.drive_log import read_drive
from zoo.driving.drive_loop import drive
from zoo.driving.drive_record import Drive
from zoo.driving.metrics import measure
from zoo.driving.replay_world import ReplayWorld, VirtualCar, seconds_of_rows
from zoo.driving.scenario import Scenario
from zoo.scoring.evidence import other_car_line
from zoo.scoring.replay_score import keyboard_lines

ROWS = 250  # 16.6 s
CAR = replace(UDACITY, name="my car")


def replay(recording, besides=0.0, margin=None, show=None, **world: float) -> Drive:
    """Drive on a recording with the recorded steering plus a constant."""
    recorded = iter(recording.steering + besides)

    def steer(frame: np.ndarray, speed_mph: float) -> tuple[float, None]:
        assert frame.shape == (160, 320, 3)
        assert frame.dtype == np.uint8
        return float(next(recorded)), None

    return drive(steer, ReplayWorld(recording, **world), Scenario(margin=margin), show)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return write_recording(tmp_path_factory.mktemp("replayed") / "lake", rows=ROWS).folder


@pytest.fixture(scope="module")
def recording(folder):
    return read_recordings(str(folder))


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory) -> str:
    return str(write_constant(tmp_path_factory.mktemp("constant") / "best.ckpt", 0.05))


@pytest.fixture(scope="module")
def as_recorded(recording) -> tuple[Drive, list[np.ndarray]]:
    """Return a drive with the recorded steering, and its frames."""
    frames = []
    return replay(recording, show=lambda frame, row: frames.append(frame)), frames


def test_who_steers_as_recorded_stays_on_the_path(recording, as_recorded):
    driven, _ = as_recorded
    figures = measure(driven)

    assert len(driven.rows) == len(driven.distance_m) == ROWS
    assert figures["autonomy"] == 1
    assert figures["cte_max_m"] < 1e-9
    assert figures["steering_per_s"] == pytest.approx(figures["expert_steering_per_s"], rel=0.01)
    assert figures["driven_s"] == pytest.approx((ROWS - 1) / 15, rel=0.01)
    driven_m = recording.speed_mph.mean() * MPS_PER_MPH * figures["driven_s"]
    assert figures["driven_m"] == pytest.approx(driven_m, rel=0.01)


def test_who_steers_farther_right_leaves_the_path_sees_that_and_is_put_back(recording, as_recorded):
    frames = []
    driven = replay(recording, 0.05, show=lambda frame, row: frames.append(frame))

    straight = as_recorded[1]
    assert np.array_equal(frames[0], straight[0])
    assert not np.array_equal(frames[8], straight[8])
    cte, lost = driven.cross_track_m, driven.intervention
    assert cte.min() >= 0
    assert np.array_equal(lost, cte > 1)
    assert lost.sum() > 2
    assert (cte[1:][lost[:-1]] == 0).all()
    autonomy = 1 - 6 * lost.sum() / driven.time_s[-1]
    assert measure(driven)["autonomy"] == max(0, autonomy)


@pytest.mark.slow
def test_a_smaller_margin_finds_more_interventions(recording):
    margins = 0.3, 1.0, 2.0
    counts = [replay(recording, 0.05, margin).intervention.sum() for margin in margins]
    assert counts[0] > counts[1] > counts[2] > 0


def test_a_recording_of_the_centre_camera_alone_will_do(tmp_path):
    folder = write_recording(tmp_path / "one", rows=ROWS, cameras=("center",)).folder

    assert 0 < np.abs(replay(read_recordings(str(folder)), 0.02).cross_track_m).max() < 2


def test_the_limit_of_the_warp_is_stated_for_the_rig_on_which_it_was_measured(recording):
    assert "believable up to 1.5 m" in ReplayWorld(recording).words
    other = replace(recording, rig=replace(UDACITY, name="a van"))
    assert "a van; warped frames: not measured" in ReplayWorld(other).words


@given(besides=st.floats(-0.3, 0.3), metres=st.floats(0.1, 6))
def test_on_a_straight_path_the_car_drives_the_circle_of_its_steering(besides, metres):
    car = VirtualCar(UDACITY)
    radius = 1 / UDACITY.curvature(besides) if abs(besides) > 1e-6 else math.inf
    car.step(besides, 0.0, metres, 200)
    if math.isinf(radius):
        assert car.right_m == pytest.approx(0, abs=1e-4)
        return
    # Offset and heading of the circle after `metres` along the path.
    assert car.heading_rad == pytest.approx(math.asin(metres / radius), abs=1e-3)
    aside = radius - math.copysign(math.sqrt(radius**2 - metres**2), radius)
    assert car.right_m == pytest.approx(aside, abs=1e-3)


def test_a_car_outside_of_a_bend_with_its_radius_stays_beside_the_path():
    recorded = 0.2
    radius = 1 / UDACITY.curvature(recorded)
    steering = math.degrees(math.atan(2.87 / (radius + 0.5))) / 25  # half a metre farther outside
    car = VirtualCar(UDACITY, right_m=-0.5)

    car.step(steering, recorded, 40.0, 400)

    assert car.right_m == pytest.approx(-0.5, abs=1e-3)
    assert car.heading_rad == pytest.approx(0, abs=1e-3)


@pytest.mark.slow
def test_it_begins_anew_after_a_pause_and_with_another_recording(tmp_path, folder):
    other = write_recording(tmp_path / "other", rows=ROWS, seed=1).folder
    recording = read_recordings([str(folder), str(other)])
    time_s = recording.time_s.copy()
    time_s[100:ROWS] += 30.0
    recording = replace(recording, time_s=time_s)

    seconds = seconds_of_rows(recording)
    assert np.flatnonzero(np.isnan(seconds)).tolist() == [99, ROWS - 1, 2 * ROWS - 1]

    driven = replay(recording, 0.01)
    cte = driven.cross_track_m
    assert cte[100] == cte[ROWS] == 0
    assert min(cte[99], cte[ROWS - 1]) > 0
    assert driven.time_s[-1] == pytest.approx((2 * ROWS - 4) / 15 + 1 / 15, rel=0.01)


def test_without_times_it_asks_for_the_frame_rate(recording):
    timeless = replace(recording, time_s=np.full(ROWS, np.nan))

    with pytest.raises(InputError, match=r"row 1: center_.*no time.*frame_rate=15"):
        replay(timeless)

    assert replay(timeless, frame_rate=10.0).time_s[-1] == pytest.approx((ROWS - 1) / 10)


def test_without_speed_nothing_is_driven_until_one_is_given(recording):
    parked = replace(recording, speed_mph=np.zeros(ROWS))

    with pytest.raises(InputError, match=r"lake: .*0 mph in each row.*speed=9"):
        replay(parked)

    figures = measure(replay(parked, speed_mph=9.0))
    assert figures["driven_m"] == pytest.approx(9 * MPS_PER_MPH * (ROWS - 1) / 15, rel=0.01)
    assert figures["speed_mph"] == 9.0


def test_a_recording_that_holds_its_speed_keeps_it_beside_one_without(recording):
    second = np.arange(ROWS) >= ROWS // 2
    mph = np.where(second, 0.0, recording.speed_mph)
    mixed = replace(recording, names=("a", "b"), recording=second.astype(int), speed_mph=mph)
    replayed = ReplayWorld(mixed, speed_mph=9.0).recording.speed_mph
    assert replayed.tolist() == np.where(second, 9.0, mph).tolist()


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"margin": 0.0}, "margin=0"),
        ({"margin": 5.0}, "margin=5"),
        ({"margin": math.nan}, "margin=nan"),
        ({"frame_rate": 0.0}, "frame_rate=0"),
    ],
)
def test_an_option_that_cannot_be_is_one_line(recording, keywords, message):
    with pytest.raises(InputError, match=message):
        replay(recording, **keywords)


@pytest.mark.parametrize(
    ("rigs", "message", "cars"),
    [
        ((UDACITY, CAR), "a, b: their rigs differ", "Udacity's simulator and my car"),
        ((CAR, None), "b: the rig is unknown", "my car and a car of unknown make"),
        ((None, None), "a, b: the rig is unknown", "a car of unknown make"),
    ],
)
def test_cars_are_named_and_what_keeps_them_from_one_replay(recording, rigs, message, cars):
    half = np.arange(ROWS) // (ROWS // 2)
    both = replace(recording, names=("a", "b"), recording=half, rig=None, rigs=rigs)
    with pytest.raises(InputError, match=f"^{message}"):
        ReplayWorld(both)
    assert other_car(both) == cars
    of_either = [other_car_line({"source": cars}, "b", name) for name in cars.split(" and ")]
    assert not any(of_either)
    assert "my truck" in other_car_line({"source": cars}, "c", "my truck")


def test_a_recording_too_short_to_replay_says_how_long_it_must_be(recording):
    short = recording.keep(np.arange(ROWS) < 60)
    with pytest.raises(InputError, match=r"3\.9 s of driving.* 12 s or more"):
        replay(short)


def test_a_damaged_picture_is_named_with_its_row(tmp_path):
    written = write_recording(tmp_path / "bad", rows=ROWS)
    image = written.image(20)
    image.write_bytes(image.read_bytes()[:300])
    with pytest.raises(InputError, match=r"row 21: .*center_.*truncated.*drivezoo edit "):
        replay(read_recordings(str(written.folder)))


def test_damaged_images_are_refused_at_once_or_left_out_and_counted(tmp_path, checkpoint):
    written = write_recording(tmp_path / "bad", rows=ROWS)
    written.image(20).unlink()
    image = written.image(80)
    image.write_bytes(image.read_bytes()[:300])
    words = checkpoint, str(written.folder), "out=out", "data.on_bad_image=skip"
    printed = succeed(run_here(tmp_path, *words, module="zoo.commands.replay"))
    assert "skipped 2 rows with a bad image" in printed
    assert len(read_drive(tmp_path / "out")) == ROWS - 2

    written.image(20).write_bytes(written.image(21).read_bytes())
    line = only_line(run_here(tmp_path, *words[:2], module="zoo.commands.replay"), 1)
    assert re.search(r"row 81: .*truncated; data\.on_bad_image=skip", line)
    assert not (tmp_path / "outputs").exists()


def test_the_command_prints_a_table_and_writes_figures_and_frames(tmp_path, checkpoint, folder):
    words = (checkpoint, str(folder), "out=a b", "frames=true", "margin=0.8")
    printed = succeed(run_here(tmp_path, *words, module="zoo.commands.replay"))

    assert "autonomy" in printed
    assert "keyboard" not in printed
    for meaningless in ("laps", "lap time", "stalled", "expert", "drives", "speed"):
        assert meaningless not in printed.replace(str(folder), "")
    out = tmp_path / "a b"
    metrics = json.loads((out / "metrics.json").read_text())
    assert metrics["margin_m"] == 0.8
    driven = read_drive(out)
    assert len(driven) == ROWS
    assert driven.intervention.sum() == metrics["replay"]["interventions"]
    assert all((out / frame).is_file() for frame in driven.frame)
    assert (out / "error.png").is_file()

    assert "a b: is not empty" in only_line(
        run_here(tmp_path, *words, module="zoo.commands.replay")
    )


@pytest.mark.parametrize(("share", "lines"), [(0.41, 1), (0.4, 0)])
def test_a_keyboards_recording_is_said_to_mean_little(recording, share, lines):
    steering = np.where(np.arange(ROWS) < share * ROWS, 0.0, 0.1)
    warnings = keyboard_lines(replace(recording, steering=steering), on_track=True)

    assert len(warnings) == lines
    for line in warnings:
        assert recording.names[0] in line
        assert "41%" in line
        assert "keyboard" in line
        assert "drivezoo evaluate CKPT track=" in line


def test_the_replay_command_warns_of_a_keyboard(tmp_path, checkpoint):
    written = write_recording(tmp_path / "keys[/red]", rows=190)
    log = written.folder / "driving_log.csv"
    rows = [line.split(",") for line in log.read_text().splitlines()]
    log.write_text("\n".join(",".join([*row[:3], "0", *row[4:]]) for row in rows) + "\n")

    words = checkpoint, str(written.folder), "out=out"
    text = succeed(run_here(tmp_path, *words, module="zoo.commands.replay"))
    assert text.index("autonomy") < text.index("keys[/red]: 100% of the steering is exactly 0")


def test_a_wrong_command_is_one_line(tmp_path, checkpoint, folder):
    for arguments, message in (
        ((checkpoint,), "usage: drivezoo replay"),
        ((checkpoint, str(folder), "marign=2"), "did you mean margin?"),
        ((checkpoint, str(folder), "margin=9"), "margin=9: must be a number above 0, up to 2"),
        ((checkpoint, str(folder), "format=nonsense"), "format=nonsense: no such format"),
        ((checkpoint, "nowhere"), "nowhere: no such folder"),
        (("nothing.ckpt", str(folder)), "nothing.ckpt"),
    ):
        assert message in only_line(run_here(tmp_path, *arguments, module="zoo.commands.replay"))
    assert not list(tmp_path.iterdir())

"""The expert and the simulated student, who drive the included tracks."""

import functools
from dataclasses import dataclass
from itertools import product

import numpy as np
import pytest

from datamodules.recording_format import read_recordings
from tests.slow_members import slow, slow_but
from tests.zoo.simulator.test_record import GreyRenderer
from tests.zoo.simulator.tracks import loop
from zoo.base.errors import InputError
from zoo.base.rig import MPS_PER_MPH
from zoo.simulator.expert import Expert, ExpertSettings, speed_limits
from zoo.simulator.hand_control import REACTION_S, HumanControl
from zoo.simulator.record import RecordOptions, record, record_laps
from zoo.simulator.recorder import Recorder
from zoo.simulator.simulated_world import Start, World, open_world
from zoo.simulator.track_file import read_track, track_names
from zoo.simulator.udacity_car import PHYSICS_STEP_S


def everywhere(*plain: tuple[str, int]) -> pytest.MarkDecorator:
    """Return the parameters of all tracks and directions; only these run in the plain tests."""
    cases = product(track_names(), (1, -1))
    return pytest.mark.parametrize(("track", "direction"), slow_but(plain, cases))


SWAYING = ExpertSettings(noise=1, seed=3)


@dataclass
class Drive:
    """A drive's figures, float64 [frames]; `recording` is bool [frames]."""

    cte: np.ndarray
    steering: np.ndarray
    throttle: np.ndarray
    speed_mph: np.ndarray
    recording: np.ndarray
    world: World


@functools.cache
def drive(track: str, direction: int, laps=1.0, settings=None, **options) -> Drive:
    world = open_world(track, renderer="none", direction=direction, **options)
    expert = Expert(world.track, settings)
    rows = []
    while world.travelled < laps * world.track.length and world.time < 200 * laps:
        steering, throttle = expert(world)
        world.step(steering, throttle)
        rows.append((world.cte, steering, throttle, world.car.speed_mph, expert.recording))
    *columns, recording = np.array(rows).T
    return Drive(*columns, recording.astype(bool), world)


@everywhere(("zoo_lake", 1), ("zoo_mountain", -1), ("udacity_jungle", 1))
def test_it_laps_close_to_the_centreline(track, direction):
    lap = drive(track, direction)
    assert lap.world.lap == 1
    # The jungle's tightest bends need nearly all of the steering lock.
    least = 2 if track == "udacity_jungle" else 1
    assert np.abs(lap.cte).mean() < 0.1 * least
    assert np.abs(lap.cte).max() < 0.4 * least
    assert lap.recording.all()


@everywhere(("zoo_lake", 1), ("udacity_jungle", -1))
def test_it_sways_off_and_comes_back_and_stays_on_the_road(track, direction):
    lap = drive(track, direction, settings=SWAYING)
    half = lap.world.track.width / 2
    assert lap.world.lap == 1
    assert 0.35 * half < np.abs(lap.cte).max() < 0.7 * half
    assert (lap.cte > 0.3 * half).any()
    assert (lap.cte < -0.3 * half).any()
    assert 0.5 < lap.recording.mean() < 0.85


def test_only_the_way_back_of_a_sway_is_recorded():
    lap = drive("zoo_lake", 1, settings=SWAYING)
    ends = np.flatnonzero(~lap.recording[:-1] & lap.recording[1:]) + 1
    ends = ends[ends + 30 < len(lap.cte)]
    assert len(ends) >= 5
    assert (np.abs(lap.cte[ends + 30]) < 0.35 * np.abs(lap.cte[ends])).all()
    assert (np.abs(lap.cte[ends]) >= 0.5).all()


def test_its_steering_is_smooth():
    changes = np.diff(drive("zoo_lake", 1, settings=SWAYING).steering)
    assert np.abs(changes).max() <= 4.0 / 15 + 1e-9
    clean = np.diff(drive("zoo_lake", 1).steering)
    assert np.abs(clean).max() < 0.05
    turns = np.sign(clean[np.abs(clean) > 0.002])
    assert np.count_nonzero(np.diff(turns)) < 0.05 * len(clean)


def test_the_same_seed_sways_the_same_and_another_does_not():
    swaying = [ExpertSettings(noise=0.5, seed=seed) for seed in (1, 1, 2)]
    drives = [drive("lake", 1, 0.3, settings).steering for settings in swaying]
    assert np.array_equal(drives[0], drives[1])
    assert not np.array_equal(drives[0][:100], drives[2][:100])


@pytest.mark.parametrize(
    "option", [{"delay_s": 0.2}, {"frame_rate": 50}, {"frame_rate": 5}], ids=str
)
def test_it_drives_with_a_delay_and_other_frame_rates(option):
    assert np.abs(drive("mountain", 1, 0.5, **option).cte).max() < 0.6


def test_it_returns_from_the_edge_and_from_the_grass():
    for start in (Start(330, cte=2.8, heading_deg=10, speed_mph=25), Start(330, cte=-5)):
        world = open_world("lake", renderer="none")
        world.put_back(start)
        expert = Expert(world.track)
        for _ in range(15 * 12):
            world.step(*expert(world))
        assert abs(world.cte) < 0.15


def test_it_holds_the_speed_and_the_line_beside_the_centre_that_it_is_given():
    driven = drive("mountain", 1, 0.5, ExpertSettings(speed_mph=15, offset_m=-0.8))
    assert np.abs(driven.speed_mph[75:] - 15).max() < 1.0
    assert driven.cte[60:].mean() == pytest.approx(-0.8, abs=0.05)


def test_it_holds_the_throttle_down_at_top_speed_as_a_person_does():
    assert np.mean(drive("zoo_lake", 1).throttle == 1) > 0.7


@pytest.mark.parametrize("direction", [1, -1])
def test_speed_limits_leave_room_to_brake(direction):
    track, settings = read_track("mountain"), ExpertSettings()
    limits = speed_limits(track, settings, direction)
    across = limits**2 * np.abs(track.curvature)
    assert across.max() < settings.cornering_mps2 + 1e-6
    assert limits.max() == pytest.approx(30 * MPS_PER_MPH)
    after = np.roll(limits, -direction)
    step = track.length / len(limits)
    assert ((limits**2 - after**2) / (2 * step)).max() < settings.braking_mps2 + 1e-6


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"speed_mph": 3}, "speed_mph=3: must be a number in 8..30"),
        ({"noise": 1.5}, "noise=1.5: must be a number in 0..1"),
        ({"offset_m": 3}, "offset_m=3: must be in -2.2..2.2"),
    ],
)
def test_wrong_settings_are_refused(settings, message):
    with pytest.raises(InputError, match=message):
        Expert(read_track("lake"), ExpertSettings(**settings))


ROW_S = 1 / 15


@functools.cache
def drive_by_hand(control: str, seed: int, laps: float) -> tuple[np.ndarray, World]:
    """Drive on the lake; return the steering of each physics step, and the world."""
    world = open_world("lake", renderer="none", frame_rate=1 / PHYSICS_STEP_S)
    expert = Expert(world.track, ExpertSettings(reaction_s=REACTION_S[control]))
    human = HumanControl(control, expert, seed)
    steering = []
    while world.travelled < laps * world.track.length:
        command = human(world)
        steering.append(command[0])
        world.step(*command)
        assert not world.off_road, f"left the road at {world.place.distance:.0f} m"
    return np.array(steering), world


@pytest.mark.parametrize("seed", [1, *slow(0, 2)])
@pytest.mark.parametrize("control", REACTION_S)
def test_a_lap_stays_on_the_road_and_steers_like_a_person(control, seed):
    steering, world = drive_by_hand(control, seed, 1.0)
    assert world.travelled >= world.track.length
    zeros = np.mean(steering == 0)
    if control == "keyboard":
        assert 0.4 < zeros < 0.9
        assert np.abs(steering).max() > 0.3  # in bursts
    else:
        assert zeros < 0.2
        assert np.abs(np.diff(steering)).max() < 0.1


@pytest.mark.parametrize("control", REACTION_S)
def test_the_same_seed_steers_the_same_and_another_does_not(control):
    first, again, other = (drive_by_hand.__wrapped__(control, seed, 0.1)[0] for seed in (1, 1, 2))
    assert np.array_equal(first, again)
    assert not np.array_equal(first[:400], other[:400])


def test_keyboard_taps_last_a_fraction_of_a_second():
    pressed = np.diff(np.r_[0, drive_by_hand("keyboard", 1, 1.0)[0] != 0, 0])
    lengths_s = (np.flatnonzero(pressed < 0) - np.flatnonzero(pressed > 0)) * PHYSICS_STEP_S
    assert len(lengths_s) > 10
    assert 0.1 < np.median(lengths_s) < 0.5


@pytest.mark.parametrize("control", REACTION_S)
def test_a_person_s_laps_become_rows_at_the_recorder_s_rate(tmp_path, control):
    world = World(loop(), GreyRenderer(), frame_rate=1 / PHYSICS_STEP_S)
    human = HumanControl(control, Expert(world.track))
    with Recorder(tmp_path) as recorder:
        driven = record(world, human, recorder, 0.25, row_s=ROW_S)
    assert recorder.rows == driven.frames == pytest.approx(world.time / ROW_S, abs=1)
    gaps = np.diff(read_recordings(str(tmp_path)).time_s)
    assert np.abs(gaps - ROW_S).max() < PHYSICS_STEP_S


def test_control_chooses_who_drives(tmp_path, console):
    steering = {}
    for control in ("expert", *REACTION_S):
        out = str(tmp_path / control)
        options = RecordOptions(out=out, laps=0.01, control=control, start=320, quality="simple")
        steering[control] = read_recordings(str(record_laps(options, console))).steering
    assert np.mean(steering["keyboard"] == 0) > np.mean(steering["mouse"] == 0)
    assert not np.array_equal(steering["expert"][:20], steering["mouse"][:20])

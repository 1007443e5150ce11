"""The simulated student at keyboard or mouse: laps that look like a person's recording."""

import functools

import numpy as np
import pytest

from datamodules.recording import read_recordings
from simulator.expert import Expert, ExpertSettings
from simulator.human_control import REACTION_S, HumanControl
from simulator.record import RecordOptions, record, record_laps
from simulator.recorder import Recorder
from simulator.rig import PHYSICS_STEP_S
from simulator.world import World, open_world
from tests.simulator.test_record import GreyRenderer
from tests.simulator.tracks import loop

ROW_S = 1 / 15


@functools.cache
def drive(control: str, seed: int, laps: float) -> tuple[np.ndarray, World]:
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


def assert_like_a_person(control: str, steering: np.ndarray) -> None:
    zeros = np.mean(steering == 0)
    if control == "keyboard":
        assert 0.4 < zeros < 0.9
        assert np.abs(steering).max() > 0.3  # in bursts
    else:
        assert zeros < 0.2
        assert np.abs(np.diff(steering)).max() < 0.1


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("control", REACTION_S)
def test_a_lap_stays_on_the_road_and_steers_like_a_person(control, seed):
    steering, world = drive(control, seed, 1.0)
    assert world.travelled >= world.track.length
    assert_like_a_person(control, steering)


@pytest.mark.parametrize("control", REACTION_S)
def test_the_same_seed_steers_the_same_and_another_does_not(control):
    first, again, other = (drive.__wrapped__(control, seed, 0.1)[0] for seed in (1, 1, 2))
    assert np.array_equal(first, again)
    assert not np.array_equal(first[:400], other[:400])


def test_keyboard_taps_last_a_fraction_of_a_second():
    pressed = np.diff(np.r_[0, drive("keyboard", 1, 1.0)[0] != 0, 0])
    lengths_s = (np.flatnonzero(pressed < 0) - np.flatnonzero(pressed > 0)) * PHYSICS_STEP_S
    assert len(lengths_s) > 10
    assert 0.1 < np.median(lengths_s) < 0.5


@pytest.mark.parametrize("control", REACTION_S)
def test_a_person_s_laps_become_rows_at_the_recorder_s_rate(tmp_path, control):
    world = World(loop(), GreyRenderer(), frame_rate=1 / PHYSICS_STEP_S)
    human = HumanControl(control, Expert(world.track))
    with Recorder(tmp_path) as recorder:
        driven = record(world, human, recorder, 0.5, row_s=ROW_S)
    assert recorder.rows == driven.frames == pytest.approx(world.time / ROW_S, abs=1)
    gaps = np.diff(read_recordings(str(tmp_path)).time_s)
    assert np.abs(gaps - ROW_S).max() < PHYSICS_STEP_S


def test_control_chooses_who_drives(tmp_path, console):
    steering = {}
    for control in ("expert", *REACTION_S):
        out = str(tmp_path / control)
        options = RecordOptions(out, laps=0.01, control=control, start=320, quality="simple")
        steering[control] = read_recordings(str(record_laps(options, console))).steering
    assert np.mean(steering["keyboard"] == 0) > np.mean(steering["mouse"] == 0)
    assert not np.array_equal(steering["expert"][:20], steering["mouse"][:20])

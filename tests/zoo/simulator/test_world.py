"""A car on a track in its weather, without a renderer, and the settings of all worlds."""

import numpy as np
import pytest

from tests.refusals import refusal
from tests.zoo.simulator.tracks import loop
from zoo.base.command_keys import keys_of
from zoo.base.key_values import read_options
from zoo.simulator.command_options import ClientOptions
from zoo.simulator.expert import Expert
from zoo.simulator.hand_drive import DriveOptions
from zoo.simulator.record import RecordOptions
from zoo.simulator.simulated_world import Start, World, open_world
from zoo.simulator.track import SOLID_M
from zoo.simulator.udacity_car import WHEEL_TRACK_M
from zoo.simulator.weather import random_weather, read_weather


def drive(world: World, seconds: float, steering: float = 0.0, throttle: float = 0.0) -> dict:
    for _ in range(round(seconds / world.frame_s)):
        world.step(steering, throttle)
    return world.info()


both_ways = pytest.mark.parametrize("direction", [1, -1])


@both_ways
def test_right_of_the_road_is_positive_as_the_driver_sees_it(direction):
    world = World(loop(), direction=direction)
    world.put_back(Start(10, cte=1, heading_deg=5))
    assert world.cte == pytest.approx(1, abs=0.02)
    assert np.degrees(world.heading_error) == pytest.approx(5, abs=0.5)
    world.put_back(Start(30, speed_mph=20))
    assert drive(world, 0.6, steering=0.3)["cte"] > 0.1


@both_ways
def test_progress_grows_in_the_driving_direction(direction):
    world = World(loop(), direction=direction)
    world.put_back(Start(0, speed_mph=20))
    info = drive(world, 1, throttle=0.3)
    assert info["progress"] * world.track.length == pytest.approx(9, abs=1)
    assert info["lap"] == 0
    distance = info["distance"] if direction > 0 else world.track.length - info["distance"]
    assert distance == pytest.approx(9, abs=1)


@both_ways
def test_a_lap_counts_when_its_whole_length_is_driven(direction):
    world = World(loop(), direction=direction)
    world.put_back(Start(-direction * 10.0))
    expert, laps = Expert(world.track), []
    while world.lap < 2:
        world.step(*expert(world))
        laps.append((world.lap, int(world.info()["progress"])))
    assert all(lap == whole for lap, whole in laps)
    assert world.travelled == pytest.approx(2 * world.track.length, abs=1)


@both_ways
def test_reversing_over_the_line_and_crossing_it_again_is_no_lap(direction):
    world = World(loop(), direction=direction)
    world.put_back(Start(direction * 2.0))
    info = drive(world, 4, throttle=-1)
    assert info["progress"] * world.track.length < -4
    assert info["lap"] == 0
    info = drive(world, 3, throttle=1)
    assert 0 < info["progress"] < 0.1
    assert info["lap"] == 0


def test_putting_the_car_back_changes_neither_progress_nor_time():
    world = World(loop())
    before = drive(world, 2, throttle=1)
    world.put_back(Start(200, cte=0.5, speed_mph=10))
    after = world.info()
    assert after["distance"] == pytest.approx(200, abs=0.01)
    assert (after["cte"], after["speed_mph"]) == pytest.approx((0.5, 10), abs=0.01)
    keys = ("progress", "lap", "time")
    assert [after[key] for key in keys] == [before[key] for key in keys]


def test_off_the_road_is_beyond_the_edge_line_and_slows_the_car():
    world = World(loop())
    world.put_back(Start(10, cte=-3.0, speed_mph=20))
    assert not world.off_road
    on_road = drive(world, 1)
    world.put_back(Start(10, cte=-5.0, speed_mph=20))
    assert world.off_road
    assert drive(world, 1)["speed_mph"] < on_road["speed_mph"] - 4


@pytest.mark.parametrize("kind", ["wall", "rock", "cliff", "barriers"])
def test_walls_keep_the_car_in_and_slow_it_and_stop_it_head_on(kind):
    world = World(loop(verge={"left": kind, "right": kind}))
    world.put_back(Start(5, heading_deg=20, speed_mph=25))
    info = drive(world, 1.5, throttle=1)
    allowed = world.track.width / 2 + SOLID_M[kind] - WHEEL_TRACK_M / 2 + 0.01
    assert abs(info["cte"]) <= allowed
    assert info["speed_mph"] < 20
    world.put_back(Start(20, heading_deg=90, speed_mph=25))
    info = drive(world, 3, throttle=1)
    assert info["off_road"]
    assert info["speed_mph"] < 5
    assert abs(info["cte"]) <= allowed


@pytest.mark.parametrize(
    ("frame_rate", "steps"), [(50, [1, 1, 1, 1]), (15, [3, 4, 3, 3, 4, 3]), (12.5, [4, 4, 4])]
)
def test_a_frame_takes_whole_steps_of_physics_and_they_never_drift(frame_rate, steps):
    world = World(loop(), frame_rate=frame_rate)
    counts = []
    for _ in steps:
        before = world.steps
        world.step(0, 0)
        counts.append(world.steps - before)
    assert counts == steps
    drive(world, 120)
    assert world.time == pytest.approx(world.frames / frame_rate, abs=0.011)


@pytest.mark.parametrize("delay_s", [0.02, 0.1, 0.5])
def test_a_command_reaches_the_wheels_after_the_delay(delay_s):
    world = World(loop(), frame_rate=50, delay_s=delay_s)
    world.put_back(Start(10, speed_mph=20))
    before = world.car.heading
    drive(world, delay_s, steering=0.3)
    assert (world.car.heading, world.car.steering) == (before, 0)
    drive(world, 0.02, steering=0.3)
    assert world.car.steering == 0.3
    assert world.car.heading < before


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ({"frame_rate": 0}, "frame_rate=0"),
        ({"frame_rate": 60}, "frame_rate=60"),
        ({"delay_s": -1}, "delay_s=-1"),
        ({"direction": 2}, "direction=2"),
    ],
)
def test_a_wrong_option_is_refused(option, message):
    assert message in refusal(open_world, "lake", renderer="none", **option)


def test_a_world_without_a_renderer_has_no_frames():
    assert "renderer=auto" in refusal(World(loop()).frame)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("foggy", "must be clear, random or settings"),
        ("{fog:2}", "fog:2: no such key; write fog: 2, with a space"),
        ("{fogg: 1}", "fogg: no such key; did you mean fog?"),
        ("{fog: 2}", "fog=2: must be a number in 0..1"),
        ("{texture_seed: -5}", "texture_seed=-5: must be a whole number of 0 or more"),
        ("{fog: thick}", "fog=thick: must be a number"),
        ("{camera: {pich_deg: 2}}", "did you mean camera.pitch_deg?"),
        ("{camera: 3}", "camera: no such key; did you mean camera."),
        ("{fog: [", "must be clear, random or settings"),
    ],
)
def test_a_wrong_weather_is_named(text: str, words: str) -> None:
    assert words in refusal(read_weather, text)


def test_a_random_day_is_the_same_for_the_same_seed_and_another_for_another() -> None:
    days = [random_weather(np.random.default_rng(seed)) for seed in (1, 1, 2)]
    assert days[0] == days[1] != days[2]


def test_random_days_are_of_every_kind() -> None:
    days = [random_weather(np.random.default_rng(seed)) for seed in range(200)]
    for kind in ("fog", "rain", "wet"):
        share = np.mean([getattr(day, kind) > 0 for day in days])
        assert 0.1 < share < 0.45
    assert 0.6 < np.mean([day.shadows for day in days]) < 0.95


@pytest.mark.parametrize("kind", [ClientOptions, DriveOptions, RecordOptions])
@pytest.mark.parametrize(
    ("typed", "direction"), [("forward", 1), ("1", 1), ("backward", -1), ("-1", -1)]
)
def test_a_direction_has_a_name_and_a_number(kind: type, typed: str, direction: int) -> None:
    options = read_options(kind, ["out=x"] * (kind is not ClientOptions) + [f"direction={typed}"])
    options.check()
    assert options.direction == direction
    assert "forward" in [key.typed for key in keys_of(kind) if key.name == "direction"]


def test_each_loop_has_its_own_duration_and_delay():
    world = World(loop(), loop=[(0.04, 0.0), (0.2, 0.1), (0.06, 0.3)])
    seconds, late_s = [0.04, 0.2, 0.06], [0.0, 0.1, 0.3]
    durations, arrived = [], []
    for _ in range(6):
        before = world.time
        world.step(0.5, 0)
        durations.append(round(world.time - before, 2))
        arrived.append(world.car.steering)
        world.put_back(Start(10))  # forgets the command
    first = seconds.index(durations[0])
    order = [(first + number) % 3 for number in range(6)]
    assert durations == [seconds[part] for part in order]
    assert arrived == [0.5 if late_s[part] < seconds[part] else 0.0 for part in order]


def test_a_later_command_never_overtakes_an_earlier_one():
    world = World(loop(), loop=[(0.04, 0.3), (0.04, 0.0)])
    for seed in range(20):
        world.reset(seed, Start(10))
        world.step(0.1, 0)
        if world.car.steering == 0:
            break  # the late loop is the first
    world.step(0.2, 0)
    assert world.car.steering == 0
    drive(world, 0.7, steering=0.2)
    assert world.car.steering == 0.2


def test_the_seed_draws_where_loop_times_begin():
    world = World(loop(), loop=[(0.02 * part, 0.0) for part in range(1, 51)])
    first = []
    for seed in (1, 2, 1):
        world.reset(seed)
        world.step(0, 0)
        first.append(world.steps)
    assert first[0] == first[2] != first[1]

"""Open roads: every drive, in both directions, ends at the road's end."""

import json
import math

import gymnasium
import numpy as np
import pytest

from tests.zoo.simulator.test_record import GreyRenderer
from tests.zoo.simulator.tracks import OPEN, open_road, write_track
from zoo.base.errors import UsageError
from zoo.simulator.client import Client
from zoo.simulator.command_options import ClientOptions
from zoo.simulator.env import DrivingEnv
from zoo.simulator.expert import Expert, ExpertSettings
from zoo.simulator.hand_control import Hands
from zoo.simulator.hand_drive import Drive
from zoo.simulator.hand_page import Seat
from zoo.simulator.record import RecordOptions, record_laps
from zoo.simulator.recorder import Recorder
from zoo.simulator.simulated_world import Start, World
from zoo.simulator.track_file import make_track

ROAD = open_road()
BARE = {"trees": 5, "bushes": 0, "rocks": 5}
both_ways = pytest.mark.parametrize("way", [1, -1])


@pytest.fixture
def road_file(tmp_path) -> str:
    return write_track(tmp_path, segments=OPEN, closed=False, surroundings=BARE)


def drive(world: World, laps: float, noise: float = 0.0) -> None:
    expert = Expert(world.track, ExpertSettings(noise=noise))
    while not world.is_complete(laps):
        world.step(*expert(world))
        assert world.time < 60


@both_ways
def test_a_lap_is_the_road_from_one_end_to_the_other(way):
    world = World(ROAD, direction=way)
    assert world.place.distance == pytest.approx(0 if way > 0 else ROAD.length)
    drive(world, 1, noise=1)
    assert world.lap == 1
    assert world.travelled == pytest.approx(ROAD.length)
    assert world.info()["progress"] == pytest.approx(1)
    assert world.at_end


@pytest.mark.parametrize(("laps", "driven"), [(0.5, 0.5), (1, 1), (7, 1)])
def test_more_laps_than_one_count_as_one(laps, driven):
    world = World(ROAD)
    drive(world, laps)
    assert world.travelled == pytest.approx(driven * ROAD.length, abs=1)
    assert world.drive_m(laps) == pytest.approx(driven * ROAD.length)


@both_ways
def test_a_car_beyond_the_end_neither_wraps_nor_fails(way):
    world = World(ROAD, direction=way)
    expert = Expert(world.track)
    world.reset(0, Start(ROAD.length / 2 + way * ROAD.length / 3, speed_mph=30))
    for _ in range(300):
        world.step(*expert(world))
    assert world.at_end
    assert math.hypot(*(np.array([world.car.x, world.car.y]) - ROAD.at(way * 1e6)[:2])) > 50
    assert world.place.distance == (ROAD.length if way > 0 else 0)
    assert world.lap == 0  # the drive began on the road
    world.put_back(Start())
    assert not world.at_end


def test_arrays_are_clamped_at_the_ends():
    for values in (ROAD.at, ROAD.heading_at, ROAD.curvature_at, ROAD.grade_at, ROAD.width_at):
        assert np.all(values(-5.0) == values(0.0))
        assert np.all(values(ROAD.length + 5) == values(ROAD.length))
    assert ROAD.at(ROAD.length) == pytest.approx(ROAD.xyz[-1])
    assert ROAD.length == pytest.approx(60 + 30 + 61 + 2 * 30 * np.pi / 3, abs=0.2)
    assert ROAD.at(ROAD.length)[2] == pytest.approx(1, abs=0.1)
    assert ROAD.locate(-30, 1).distance == 0
    assert ROAD.locate(-30, 1, near=0).cte == pytest.approx(-1)


@both_ways
@pytest.mark.parametrize("ahead_m", [-50, ROAD.length, ROAD.length + 50])
def test_a_start_at_the_end_or_off_the_road_is_refused(way, ahead_m):
    world = World(ROAD, direction=way)
    start_m = world.track.begin(way) + way * ahead_m
    with pytest.raises(UsageError, match=f"start={start_m:g}: .* of the open road road; start"):
        world.reset(0, Start(start_m))


@both_ways
def test_random_starts_leave_road_ahead(way):
    world = World(ROAD, direction=way)
    rng = np.random.default_rng(1)
    ahead = [world.draw_distance(rng) for _ in range(200)]
    remaining = [ROAD.length - distance if way > 0 else distance for distance in ahead]
    assert min(remaining) >= 100
    assert max(remaining) > 0.9 * ROAD.length


@both_ways
def test_an_episode_terminates_at_the_end(road_file, way):
    small = {"quality": "simple", "width": 64, "height": 32}
    road = DrivingEnv(road_file, direction=way, random_start=False, **small)
    env = gymnasium.wrappers.TimeLimit(road, 2000)
    expert = Expert(env.unwrapped.world.track)
    env.reset(seed=1, options={"speed_mph": 20})
    rewards, terminated, truncated = [], False, False
    while not (terminated or truncated):
        _, reward, terminated, truncated, info = env.step(np.array(expert(env.unwrapped.world)))
        rewards.append(reward)
    assert terminated
    assert not truncated
    assert info["lap"] == 1
    assert sum(rewards) == pytest.approx(ROAD.length)
    env.close()


def test_recording_both_ways_covers_the_road_twice(road_file, tmp_path, console):
    out = tmp_path / "laps"
    common = {"laps": 3, "direction": "both", "frame_rate": 4, "quality": "simple"}
    record_laps(RecordOptions(out=str(out), track=road_file, **common), console)
    assert "laps        2.00 (" in console.file.getvalue()
    assert len(list((out / "IMG").glob("center*"))) > 100


@pytest.mark.parametrize("laps", [0, 1, 5])
def test_a_client_finishes_at_the_end(laps, console):
    world = World(ROAD)
    client = Client(world, ClientOptions(laps=laps), console)
    expert = Expert(ROAD)
    assert not client.finished
    while not world.at_end:
        world.step(*expert(world))
    assert client.finished


def test_a_person_returns_from_the_end_to_the_begin(tmp_path):
    straight = make_track("road", {"segments": [{"straight": 40}], "closed": False})
    world, seat = World(straight, GreyRenderer(), frame_rate=50), Seat()

    def notice() -> str:
        body = seat.answer({})[0]
        return json.loads(body[4 : 4 + int.from_bytes(body[:4], "little")])["notice"]

    hands = Hands({"arrow_up"})
    with Recorder(tmp_path / "laps") as recorder:
        drive = Drive(world, seat, recorder, 15)
        seat.take("press", "r")
        drive._handle_keys()
        while not world.at_end:
            drive._step(hands)
        assert len(drive.driven.lap_s) == 1
        rows = drive.recorder.rows
        assert rows > 20
        for _ in range(50):
            drive._step(hands)
        drive._show(0.0)
        assert drive.recorder.rows == rows
        assert "put the car back" in notice()
        seat.take("press", "backspace")
        drive._handle_keys()
        assert world.place.distance == 0
        drive._step(hands)
        drive._show(0.0)
        assert notice() == ""

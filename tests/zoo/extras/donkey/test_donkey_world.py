"""A Donkeycar simulator as a world: what it is told, and what one that fails is reported as."""

import socket
from collections.abc import Iterator

import numpy as np
import pytest

from tests.contracts.test_worlds import (  # noqa: F401  the contract, with the fixture below
    test_a_drive_ends_and_is_the_same_twice,
    test_a_key_that_a_world_ignores_is_refused,
    test_a_world_is_reset_stepped_and_put_back,
)
from tests.zoo.extras.donkey.donkey_process import donkey_simulator
from tests.zoo.extras.donkey.donkey_replica import Change, donkey_replica, telemetry
from zoo.base.errors import InputError
from zoo.driving.drive_loop import drive
from zoo.driving.open_world import open_world
from zoo.driving.scenario import Scenario
from zoo.driving.world import State, World
from zoo.extras.donkey import donkey_world
from zoo.extras.donkey.donkey_world import DonkeyWorld


@pytest.fixture(scope="module")
def port() -> Iterator[int]:
    with donkey_simulator("rate=max") as (port, _):
        yield port


@pytest.fixture
def opened(port: int, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[World, Scenario]]:
    monkeypatch.setattr(donkey_world, "PORT", port)
    scenario = Scenario("generated_track", laps=0.02, world="donkey")
    world = open_world(scenario)
    yield world, scenario
    world.close()


def step_through(address: str) -> list[State]:
    world = DonkeyWorld(address)
    try:
        world.reset(Scenario(address, world="donkey"))
        assert world.rig is None, "the Unity program's camera is unknown"
        return [world.step(0.1, throttle) for throttle in (0.2, -0.3, 0.2, 0.2, 0.2, 0.2)]
    finally:
        world.close()


def test_numbers_may_have_a_decimal_comma() -> None:
    def with_commas(number: int, message: dict) -> dict:
        return message | {"speed": "1,5", "time": f"{number / 20:.2f}".replace(".", ",")}

    with donkey_replica(with_commas) as (address, _):
        states = step_through(address)
    assert states[-1].time_s - states[-2].time_s == pytest.approx(0.05)
    assert 0 < states[-2].share < states[-1].share < 0.2


@pytest.mark.parametrize(("hit", "contact"), [(None, False), ("", False), ("Cone", True)])
def test_only_what_is_hit_is_a_contact(hit: str | None, contact: bool) -> None:
    with donkey_replica(lambda number, message: message | {"hit": hit}) as (address, _):
        assert {state.contact for state in step_through(address)} == {contact}


def test_the_end_of_an_open_road_ends_a_drive_without_an_intervention() -> None:
    def end(number: int, message: dict) -> dict:
        return message | {"hit": "end_of_road" if number >= 4 else "none"}

    with donkey_replica(end) as (address, _):
        before, *_, after = step_through(address)
    assert (before.done, before.lap, after.done, after.lap) == (False, 0, True, 1)
    assert not after.contact


def test_a_negative_throttle_brakes_and_a_car_that_is_left_stands() -> None:
    with donkey_replica(lambda number, message: message) as (address, received):
        step_through(address)
    controls = [message for message in received if message["msg_type"] == "control"]
    pedals = [(float(control["throttle"]), float(control["brake"])) for control in controls]
    assert (0.2, 0.0) in pedals
    assert (0.0, 0.3) in pedals
    assert pedals[-1] == (0.0, 1.0)


def test_a_slow_network_drives_by_the_newest_frame() -> None:
    with donkey_replica(lambda number, message: message, each=5) as (address, _):
        states = step_through(address)
    # A message that comes just after the last one is read is newest in the next step only.
    assert states[-1].time_s > 5 * 4 * 0.05


@pytest.mark.parametrize("kind", ["get_scene_names", "reset_car"])
def test_a_crossing_before_the_drive_is_no_lap(kind: str) -> None:
    with donkey_replica(lambda number, message: message, crossed=(kind,)) as (address, _):
        assert {state.lap for state in step_through(address)} == {0}


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda number, message: None if number == 4 else message, "left|reset|Broken pipe"),
        (lambda number, message: {} if number == 4 else message, "timed out"),
        (lambda number, message: message | {"time": "NaN"}, "time is 'NaN', no number"),
        (lambda number, message: message | {"image": "AAAA"}, "image: "),
        (lambda number, message: message | ({"image": ""} if number > 3 else {}), "image: "),
        (lambda number, message: telemetry(number, (60, 80)) if number > 3 else message, "changed"),
        (lambda number, message: message | {"more": "x" * 20_000}, "more than"),
    ],
    ids=["leaves", "silent", "nan", "image", "images", "size", "endless"],
)
def test_a_failure_is_named(monkeypatch: pytest.MonkeyPatch, change: Change, reason: str) -> None:
    monkeypatch.setattr(donkey_world, "SILENT_S", 0.5)
    monkeypatch.setattr(donkey_world, "MOST_LINE", 20_000)
    monkeypatch.setattr(donkey_world, "MOST_DAMAGED", 3)
    with donkey_replica(change) as (address, _), pytest.raises(InputError, match=reason) as caught:
        step_through(address)
    assert address in str(caught.value)


@pytest.mark.parametrize("value", ["NaN", "1e308", 1e308, -1e308, "none"])
@pytest.mark.parametrize("key", ["speed", "steering_angle", "cte", "pos_x", "activeNode"])
def test_a_value_that_no_car_has_is_unknown(key: str, value: object) -> None:
    with donkey_replica(lambda number, message: message | {key: value}) as (address, _):
        state = step_through(address)[-1]
    fields = {"speed": "speed_mph", "steering_angle": "steering", "cte": "cross_track_m"}
    unknown = getattr(state, fields.get(key, "xy"))
    if key == "activeNode":
        assert state.share == 0
    else:
        assert unknown is None or np.isnan(unknown)


@pytest.mark.parametrize("speed", ["NaN", 1e308])
def test_a_car_of_unknown_speed_gets_no_throttle_and_no_intervention(speed: object) -> None:
    seen: list[float] = []

    def policy(frame: np.ndarray, speed_mph: float) -> tuple[float, None]:
        seen.append(speed_mph)
        return 0.0, None

    def change(number: int, message: dict) -> dict:
        return message | ({"speed": speed} if number > 3 else {}) | {"time": float(number)}

    with donkey_replica(change) as (address, _):
        world = DonkeyWorld(address)
        driven = drive(policy, world, Scenario(address, laps=0.05, world="donkey"))
        world.close()
    assert np.isnan(driven.speed_mph[-1])
    assert driven.throttle[0] > 0
    assert driven.throttle[-1] == 0
    assert not driven.intervention.any()
    assert seen[-1] == seen[0], "a network sees the last speed that is known"


def test_a_silent_simulator_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(donkey_world, "SILENT_S", 0.1)
    with (
        socket.create_server(("127.0.0.1", 0)) as listener,
        pytest.raises(InputError, match="the simulator failed: timed out"),
    ):
        DonkeyWorld(f"127.0.0.1:{listener.getsockname()[1]}/oval")


@pytest.mark.parametrize("address", ["", "a b", "host:99999999/x"])
def test_an_address_that_is_none_is_named(address: str) -> None:
    with pytest.raises(InputError, match="HOST:PORT/SCENE"):
        DonkeyWorld(address)

"""Speed controllers, the filter of the steering, and the keys that choose them."""

import math
from dataclasses import replace

import pytest

from zoo.base.errors import InputError
from zoo.base.key_values import constructed, read_options
from zoo.checkpoints.policy_base import Command
from zoo.driving.speed_controller import (
    PI,
    Constant,
    Network,
    SpeedController,
    SteeringFilter,
    limit_pedal,
)
from zoo.server.drive_settings import CONTROLLERS, DriveSettings, check_settings

STEP_S = 1 / 60
STRAIGHT = Command(0.0)
WRONG_SPEEDS = (-1, "fast", "null", "true", "nan")


def hold(controller: SpeedController, seconds: float, steering: float = 0.0) -> float:
    """Return the speed in mph of a car like the original's, some seconds after a standing start."""
    speed_mph = 0.0
    for step in range(round(seconds / STEP_S)):
        throttle = controller.pedal(Command(steering), speed_mph, step * STEP_S)
        speed_mph += STEP_S * (11.0 * throttle - 0.1 * speed_mph)
    return speed_mph


def test_pi_holds_the_set_speed() -> None:
    assert hold(PI(9, 0.1, 0.002), 30) == pytest.approx(9, abs=0.1)
    assert hold(PI(20, 0.1, 0.002), 30) == pytest.approx(20, abs=0.2)


def test_proportional_stays_below_it() -> None:
    assert 7 < hold(PI(9, 0.1), 30) < 8.5


def test_pi_goes_by_the_clock_and_not_by_the_number_of_messages() -> None:
    often, seldom = PI(9, 0.1, 0.002), PI(9, 0.1, 0.002)
    for step in range(121):
        last = often.throttle(STRAIGHT, 8.0, step / 120)
    for step in range(16):
        other = seldom.throttle(STRAIGHT, 8.0, step / 15)
    assert last == pytest.approx(other)


def test_pi_does_not_wind_up_against_a_hill() -> None:
    controller = PI(9, 0.1, 0.002)
    for step in range(6_000):
        controller.throttle(STRAIGHT, 0.0, step * STEP_S)
    assert controller.throttle(STRAIGHT, 9.5, 100) < 1
    for step in range(120):
        throttle = controller.throttle(STRAIGHT, 9.5, 100 + step * STEP_S)
    assert throttle < 0.3


def test_a_pause_is_not_made_up_for() -> None:
    controller = PI(9, 0.1, 0.002)
    before = controller.throttle(STRAIGHT, 8, 0)
    assert controller.throttle(STRAIGHT, 8, 3600) < before + 0.05


def test_bends_are_taken_slowly() -> None:
    controller = PI(20, 0.1, 0.002, bend_mph=8)
    assert hold(controller, 30, steering=1.0) == pytest.approx(8, abs=0.2)
    assert controller.target_mph(STRAIGHT) == 20
    assert controller.target_mph(Command(-0.5)) == 14


def test_constant_and_the_networks_own() -> None:
    command = Command(0.0, 0.9)
    assert Constant(0.3).throttle(command, 30, 0) == 0.3
    assert Network(gain=0.5).throttle(command, 30, 0) == 0.45
    assert Network(fallback=0.1).throttle(STRAIGHT, 30, 0) == 0.1


def test_the_brake_of_a_slow_car_would_reverse_it() -> None:
    assert limit_pedal(-0.5, 20) == -0.5
    assert limit_pedal(-0.5, 4) == 0
    assert limit_pedal(7, 20) == 1
    assert limit_pedal(-7, 20) == -1


# Doubt needs a spread that is sure, and a larger one that is not.
@pytest.mark.parametrize(
    ("keys", "message"),
    [
        *(([f"speed.set_mph={value}"], r"speed\.set_mph=") for value in WRONG_SPEEDS),
        (["speed=doubt", "speed.sure=0.2", "speed.unsure=0.2"], r"speed\.(un)?sure="),
        (["speed=doubt", "speed.sure=0.3", "speed.unsure=0.2"], r"speed\.(un)?sure="),
        (["speed=doubt", "speed.sure=-0.1", "speed.unsure=0.2"], r"speed\.(un)?sure="),
        (["steering.gain=0"], r"steering\.gain=0: must be"),
        (["steering.rate_per_s=-1"], r"steering\.rate_per_s=-1: must be"),
        (["steering.low_pass_s=x"], r"steering\.low_pass_s=x: must be"),
    ],
)
def test_a_value_that_cannot_be_is_named(keys: list[str], message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_options(DriveSettings, keys)


def test_doubt_slows_down_by_the_spread() -> None:
    doubt = PI(20, 0.1, doubt_mph=5, sure=0.1, unsure=0.3)
    spreads = (0.0, 0.1, 0.2, 0.3, 0.9, None, math.nan)
    targets = [doubt.target_mph(Command(0.5, spread=spread)) for spread in spreads]
    assert targets == pytest.approx([20, 20, 12.5, 5, 5, 5, 5]), "unknown is full doubt"
    assert doubt.throttle(Command(0.0, spread=0.0), 10, 0.0) == pytest.approx(1.0)
    assert doubt.throttle(Command(0.0, spread=0.3), 10, 0.0) == pytest.approx(-0.5)
    doubt.set_mph = 3.0
    assert doubt.target_mph(Command(0.0, spread=0.9)) == 3, "never faster than the set speed"


def test_steering_is_clamped_and_changed_by_no_default() -> None:
    assert SteeringFilter(gain=3)(0.5, 0) == 1
    steer = SteeringFilter()
    values = [steer(value, now) for now, value in enumerate((0.1, -0.7, 1.0, -1.5))]
    assert values == [0.1, -0.7, 1.0, -1]


@pytest.mark.parametrize("hz", [15, 120])
@pytest.mark.parametrize(
    ("options", "reached"),
    [
        ({"rate_per_s": 0.5}, pytest.approx(0.5)),
        ({"low_pass_s": 1.0}, pytest.approx(0.632, abs=1e-3)),
    ],
)
def test_rate_limit_and_low_pass_go_by_the_clock(options: dict, reached: object, hz: int) -> None:
    steer = SteeringFilter(**options)
    steer(0.0, 0)
    assert [steer(1.0, (row + 1) / hz) for row in range(hz)][-1] == reached


def test_after_a_reset_the_first_steering_counts_in_full() -> None:
    steer = SteeringFilter(low_pass_s=1.0, rate_per_s=0.1)
    steer(0.0, 0)
    steer.reset()
    assert steer(0.8, 0.01) == 0.8


@pytest.mark.parametrize("choice", CONTROLLERS)
def test_every_way_to_choose_the_throttle_can_be_built(choice: str) -> None:
    speed = read_options(DriveSettings, [f"speed={choice}"]).speed
    speed.reset()
    assert -1 <= speed.pedal(Command(0.0, 0.5), 9.0, 0.0) <= 1


def test_the_defaults_are_the_courses_controller_on_loopback() -> None:
    settings = read_options(DriveSettings, [])
    assert isinstance(settings.speed, PI)
    assert (settings.speed.set_mph, settings.speed.kp, settings.speed.ki) == (9, 0.1, 0.002)
    assert (settings.host, settings.port, settings.record) == ("127.0.0.1", 4567, None)
    assert settings.steering(0.3, 0.0) == 0.3


def test_keys_of_a_choice_can_stand_before_it() -> None:
    settings = read_options(DriveSettings, ["speed.throttle=0.4", "speed=constant"])
    assert settings.speed.throttle(Command(0.0), 0.0, 0.0) == 0.4


@pytest.mark.parametrize("typed", ["speed=15", "speed.set_mph=15"])
def test_a_number_for_the_speed_is_the_speed_to_hold(typed: str) -> None:
    assert read_options(DriveSettings, [typed]).speed.set_mph == 15
    assert read_options(
        DriveSettings, ["speed=bends", typed.replace("speed=", "speed.set_mph=")]
    ).speed.bend_mph


def test_a_track_that_does_not_exist_is_refused_before_anything_starts() -> None:
    with pytest.raises(InputError, match=r"sim=laek: .*did you mean lake"):
        check_settings(DriveSettings(**constructed(DriveSettings, {"sim": "laek"})))
    check_settings(read_options(DriveSettings, ["sim=lake"]))


@pytest.mark.parametrize("typed", ["laps=1", "put_back=false", "scene=warren sim=lake", "page=0"])
def test_a_key_that_no_simulator_reads_is_refused(typed: str) -> None:
    with pytest.raises(InputError, match=r"^\w+: changes nothing here; drop it, or add sim= or"):
        check_settings(read_options(DriveSettings, typed.split()))
    settings = read_options(DriveSettings, typed.split()[:1])
    check_settings(replace(settings, world="another"))

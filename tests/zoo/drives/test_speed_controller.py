"""Speed controllers, and the speed that a car reaches by them."""

import math

import pytest

from zoo.base.errors import InputError
from zoo.drives.speed_controller import (
    PI,
    Constant,
    Doubt,
    Network,
    SpeedController,
    keep_limit,
    limit_pedal,
)

STEP_S = 1 / 60


def hold(controller: SpeedController, seconds: float, steering: float = 0.0) -> float:
    """Return the speed in mph of a car like the original's, some seconds after a standing start."""
    speed_mph = 0.0
    for step in range(round(seconds / STEP_S)):
        throttle = controller.throttle(speed_mph, steering, None, step * STEP_S)
        throttle = limit_pedal(throttle, speed_mph)
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
        last = often.throttle(8.0, 0, None, step / 120)
    for step in range(16):
        other = seldom.throttle(8.0, 0, None, step / 15)
    assert last == pytest.approx(other)


def test_pi_does_not_wind_up_against_a_hill() -> None:
    controller = PI(9, 0.1, 0.002)
    for step in range(6_000):
        controller.throttle(0.0, 0, None, step * STEP_S)
    assert controller.throttle(9.5, 0, None, 100) < 1
    for step in range(120):
        throttle = controller.throttle(9.5, 0, None, 100 + step * STEP_S)
    assert throttle < 0.3


def test_a_pause_is_not_made_up_for() -> None:
    controller = PI(9, 0.1, 0.002)
    before = controller.throttle(8, 0, None, 0)
    assert controller.throttle(8, 0, None, 3600) < before + 0.05


def test_bends_are_taken_slowly() -> None:
    controller = PI(20, 0.1, 0.002, bend_mph=8)
    assert hold(controller, 30, steering=1.0) == pytest.approx(8, abs=0.2)
    assert controller.target_mph(0) == 20
    assert controller.target_mph(-0.5) == 14


def test_constant_and_the_networks_own() -> None:
    assert Constant(0.3).throttle(30, 0, 0.9, 0) == 0.3
    assert Network(gain=0.5).throttle(30, 0, 0.9, 0) == 0.45
    assert Network(fallback=0.1).throttle(30, 0, None, 0) == 0.1


def test_the_brake_of_a_slow_car_would_reverse_it() -> None:
    assert limit_pedal(-0.5, 20) == -0.5
    assert limit_pedal(-0.5, 4) == 0
    assert limit_pedal(7, 20) == 1
    assert limit_pedal(-7, 20) == -1


@pytest.mark.parametrize("value", [-1, "fast", None, True, float("nan")])
def test_a_set_speed_that_cannot_be_is_named(value: object) -> None:
    with pytest.raises(InputError, match=r"speed\.set_mph="):
        PI(value, 0.1)


def test_doubt_slows_down_by_the_spread() -> None:
    doubt = Doubt(20, 0.1, 0.0, doubt_mph=5, sure=0.1, unsure=0.3)
    targets = [doubt.target_mph(0.5, spread) for spread in (0.0, 0.1, 0.2, 0.3, 0.9)]
    assert targets == pytest.approx([20, 20, 12.5, 5, 5])
    assert doubt.target_mph(0.5) == doubt.target_mph(0.5, math.nan) == 5, "unknown is full doubt"
    assert doubt.throttle(10, 0.0, None, 0.0, 0.0) == pytest.approx(1.0)
    assert doubt.throttle(10, 0.0, None, 0.0, 0.3) == pytest.approx(-0.5)


def test_doubt_never_drives_faster_than_the_set_speed() -> None:
    doubt = Doubt(20, 0.1, 0.0, doubt_mph=5, sure=0.1, unsure=0.3)
    doubt.set_mph = 3.0
    assert doubt.target_mph(0.0, 0.9) == 3


@pytest.mark.parametrize(("sure", "unsure"), [(0.2, 0.2), (0.3, 0.2), (-0.1, 0.2)])
def test_doubt_needs_a_spread_that_is_sure_and_a_larger_one_that_is_not(
    sure: float, unsure: float
) -> None:
    with pytest.raises(InputError, match=r"speed\.(un)?sure="):
        Doubt(20, 0.1, 0.0, 5, sure, unsure)


def test_a_limit_brakes_above_it_and_holds_it_below() -> None:
    pi = PI(15, 0.1, 0.002)
    pi.throttle(5, 0, None, 0.0)
    assert keep_limit(pi, 1.0, 12, 6.0) < 0
    assert 0 < keep_limit(pi, 1.0, 5, 6.0) < 1
    assert keep_limit(pi, 1.0, 12, None) == 1.0


def test_the_integral_does_not_grow_while_a_limit_holds() -> None:
    limited, free = PI(15, 0.1, 0.002), PI(15, 0.1, 0.002)
    for step in range(100):
        keep_limit(limited, limited.throttle(6, 0, None, step / 15), 6, 6.0)
    after, fresh = (one.throttle(14, 0, None, 7.0) for one in (limited, free))
    assert after == fresh

"""The car without a track: commands in, motion out; the figures are the original's."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from zoo.base.rig import MPS_PER_MPH
from zoo.simulator.car import OFF_ROAD, ROAD, Car
from zoo.simulator.udacity_car import MAX_STEERING_DEG, PHYSICS_STEP_S, WHEELBASE_M

commands = st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1)), min_size=1, max_size=20)


def drive(car: Car, seconds: float, steering=0.0, throttle=0.0, grade=0.0, surface=ROAD) -> Car:
    for _ in range(round(seconds / PHYSICS_STEP_S)):
        car.step(steering, throttle, grade, surface)
    return car


def rolling(speed_mph: float) -> Car:
    car = Car()
    car.place(0.0, 0.0, 0.0, speed_mph)
    return car


def motion(car: Car) -> tuple[float, ...]:
    return car.x, car.y, car.heading, car.ahead_mps, car.left_mps, car.yaw_rate


@given(speed=st.floats(0, 30), throttle=st.floats(-1, 1))
def test_it_keeps_straight_with_straight_wheels(speed, throttle):
    car = drive(rolling(speed), 2, throttle=throttle)
    assert (car.y, car.heading, car.left_mps) == (0, 0, 0)


@given(commands, st.floats(0, 30))
def test_mirrored_steering_mirrors_the_path(given_commands, speed):
    car, mirrored = rolling(speed), rolling(speed)
    for steering, throttle in given_commands:
        drive(car, 0.1, steering, throttle)
        drive(mirrored, 0.1, -steering, throttle)
    x, y, heading, ahead, left, yaw_rate = motion(mirrored)
    assert motion(car) == (x, -y, -heading, ahead, -left, -yaw_rate)


def test_it_turns_on_the_circle_of_its_wheels_while_slow():
    car = drive(rolling(5), 6, steering=0.5, throttle=0.05)
    radius = np.hypot(car.ahead_mps, car.left_mps) / abs(car.yaw_rate)
    expected = WHEELBASE_M / np.tan(np.radians(0.5 * MAX_STEERING_DEG))
    assert radius == pytest.approx(expected, rel=0.05)


def test_it_slips_wide_of_that_circle_when_too_fast():
    car = rolling(30)
    for _ in range(100):
        drive(car, 0.02, steering=1, throttle=1)
    across = abs(car.yaw_rate) * np.hypot(car.ahead_mps, car.left_mps)
    assert across < 1.4 * 9.81  # the limit of tyres and downforce
    assert across > 0.7 * 9.81
    radius = np.hypot(car.ahead_mps, car.left_mps) / abs(car.yaw_rate)
    assert radius > 1.5 * WHEELBASE_M / np.tan(np.radians(MAX_STEERING_DEG))


def test_full_throttle_reaches_20_mph_in_2_s_and_never_more_than_30():
    car = drive(rolling(0), 1.9, throttle=1)
    assert car.speed_mph == pytest.approx(20, abs=1.5)
    assert drive(car, 10, throttle=1).speed_mph == pytest.approx(30, abs=0.3)


def test_brakes_stop_it_from_30_mph_within_2_s_and_grip_decides_where():
    on_road = drive(rolling(30), 1.2, throttle=-1)
    off_road = drive(rolling(30), 1.2, throttle=-1, surface=OFF_ROAD)
    assert on_road.speed_mph < 5.5
    assert on_road.speed_mph < off_road.speed_mph


def test_a_negative_throttle_reverses_below_5_mph():
    car = drive(rolling(4), 3, throttle=-1)
    assert car.ahead_mps < -0.5
    assert car.speed_mph > 0
    assert drive(rolling(30), 0.5, throttle=-1).ahead_mps > 5 * MPS_PER_MPH


def test_it_rolls_out_without_throttle_and_stands():
    assert drive(rolling(10), 60).speed_mph == 0


def test_climbs_slow_it_and_descents_speed_it_up():
    assert drive(rolling(0), 10, throttle=1, grade=0.13).speed_mph > 29, "our steepest road"
    assert drive(rolling(0), 5, grade=0.004).x == 0, "friction holds it"
    up, level, down = (drive(rolling(15), 2, grade=grade) for grade in (0.1, 0.0, -0.1))
    assert up.speed_mph < level.speed_mph < down.speed_mph
    assert down.speed_mph > 15


def test_commands_beyond_full_are_full():
    assert motion(drive(rolling(10), 1, 5, 7)) == motion(drive(rolling(10), 1, 1, 1))

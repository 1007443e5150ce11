"""Commands that take effect late: a car on a straight, steered back to its line."""

import math
from collections import deque

import numpy as np
import pytest

from zoo.base.rig import MPS_PER_MPH, UDACITY
from zoo.checkpoints.frame_memory import RETURN_M, SessionPolicy, returning
from zoo.driving.latency_meter import LatencyMeter
from zoo.models.frame_window import Window

FRAME_S, MPH = 0.1, 15.0


class Car:
    """A car beside a straight line, by the bicycle model."""

    def __init__(self, right_m: float, heading: float = 0.0) -> None:
        self.right_m, self.heading = right_m, heading

    def wish(self) -> float:
        """Return the steering of pure pursuit, -1..1."""
        bend = -2 * (self.right_m + RETURN_M * self.heading) / RETURN_M**2
        wheel = math.degrees(math.atan(UDACITY.wheelbase_m * bend))
        return float(np.clip(wheel / UDACITY.steering_deg, -1, 1))

    def move(self, steering: float, seconds: float) -> None:
        bend = math.tan(math.radians(steering * UDACITY.steering_deg)) / UDACITY.wheelbase_m
        way = MPH * MPS_PER_MPH * seconds
        self.right_m += way * (self.heading + bend * way / 2)
        self.heading += bend * way


class Ahead(SessionPolicy):
    """A policy that knows the car, and predicts the course of a car that is not late."""

    def __init__(self, car: Car) -> None:
        self.car = car
        self.keep_memory((), Window(ahead=12), {"rows_per_s": 1 / FRAME_S, "speed_mph": MPH})

    def steering(self) -> float:
        car, steps = Car(self.car.right_m, self.car.heading), []
        for _ in range(13):
            steps.append([car.wish()])
            car.move(steps[-1][0], FRAME_S)
        return float(self.in_time(np.array(steps), MPH)[0])


def drive(delay: int, told: bool) -> list[float]:
    """Return the distance from the line in 10 s, for a delay in frames of 0.1 s."""
    car = Car(0.8)
    policy = Ahead(car)
    policy.in_car(UDACITY)
    meter = LatencyMeter(policy)
    wheels, passed = deque([0.0] * (delay + 1)), []
    for frame in range(100):
        passed.append(car.right_m)
        meter.report(wheels[0], frame * FRAME_S)
        policy.latency_s = delay * FRAME_S
        if not told:
            policy.expect(np.zeros(0))
        steering = policy.steering()
        meter.send(steering)
        wheels.append(steering)
        wheels.popleft()
        car.move(wheels[0], FRAME_S)
    return passed


@pytest.mark.parametrize("delay", [2, 4, 6])
def test_a_late_car_returns_as_one_that_is_not_late(delay: int) -> None:
    prompt, late = drive(0, told=True), drive(delay, told=True)
    assert min(late) > min(prompt) - 0.05
    assert max(map(abs, late[50:])) < 0.02
    assert np.allclose(late[delay:], prompt[: len(prompt) - delay], atol=0.15)


def test_without_the_sent_commands_a_late_car_returns_badly() -> None:
    late, untold = drive(6, told=True), drive(6, told=False)
    assert np.abs(untold[15:]).mean() > 3 * np.abs(late[15:]).mean()


def test_commands_as_predicted_need_no_correction() -> None:
    course = np.array([0.3, 0.2, 0.1, 0.0])
    times = (np.arange(30) + 0.5) / 10
    sent = np.interp(times, np.arange(4), course)
    assert returning(course, sent, 5.0, 3.0, UDACITY) == pytest.approx(0)
    assert returning(course, np.zeros(0), 5.0, 3.0, UDACITY) == 0.0
    right, left = (returning(course, sent + aside, 5.0, 3.0, UDACITY) for aside in (0.1, -0.1))
    assert right < 0 < left


def test_steps_of_a_faster_recording_take_longer() -> None:
    """At half of the recorded speed a step ahead is reached after twice the time."""
    policy = SessionPolicy()
    policy.keep_memory((), Window(ahead=3), {"rows_per_s": 10.0, "speed_mph": 30.0})
    policy.latency_s = 0.2
    outputs = np.array([[0.0], [0.1], [0.2], [0.3]])
    assert policy.in_time(outputs, 30.0)[0] == pytest.approx(0.2)
    assert policy.in_time(outputs, 15.0)[0] == pytest.approx(0.1)
    assert policy.in_time(outputs, 0.0)[0] == 0.0
    assert policy.in_time(outputs, math.nan)[0] == pytest.approx(0.2), "as the recorded speed"


def test_a_session_and_a_reset_have_no_commands_before() -> None:
    policy = SessionPolicy()
    policy.in_car(UDACITY)
    policy.keep_memory((), Window(ahead=3), {"rows_per_s": 10.0})
    policy.latency_s = 0.2
    policy.expect(np.full(10, 0.5))
    outputs = np.zeros((4, 1))
    assert policy.in_time(outputs, 15.0)[0] < 0
    assert policy.session().in_time(outputs, 15.0)[0] == 0
    policy.reset()
    assert policy.in_time(outputs, 15.0)[0] == 0

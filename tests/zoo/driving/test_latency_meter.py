"""The measured seconds from a command to the wheels, in the embedded world and with jitter."""

import bisect
import math

import numpy as np
import pytest

from zoo.checkpoints.policy_base import Command, Policy, PolicyWrapper, as_policy
from zoo.driving.drive_loop import drive
from zoo.driving.embedded_world import EmbeddedWorld, open_embedded
from zoo.driving.latency_meter import LatencyMeter, latency_meter
from zoo.driving.scenario import Scenario
from zoo.simulator.expert import Expert


def lake(delay_s: float = 0.0) -> EmbeddedWorld:
    return open_embedded(Scenario("lake", delay_s=delay_s), "none")


class Ahead(Policy):
    """A policy that steers as the expert does, and stores what the meter tells it."""

    latency_s = 9.0

    def __init__(self, world: EmbeddedWorld | None = None) -> None:
        self.world = (world or lake()).simulated
        self.expert = Expert(self.world.track)
        self.latencies: list[float] = []

    def __call__(self, frame: None, speed_mph: float) -> Command:
        self.latencies.append(self.latency_s)
        return Command(self.expert(self.world)[0])

    def expect(self, steering: np.ndarray) -> None:
        self.expected = steering.tolist()


def feed(meter: LatencyMeter, commands: list[float], latency: int, begin: int = 0) -> None:
    """Report each command some rows after it was sent; a row is 0.1 s.

    The shortest latency that explains this is one row less: the command takes effect between two
    reports.
    """
    for row, command in enumerate(commands):
        meter.report(commands[row - latency] if row >= latency else 0.0, (begin + row) / 10)
        meter.send(command)


@pytest.fixture
def commands() -> list[float]:
    return np.random.default_rng(0).uniform(-0.2, 0.2, 60).tolist()


@pytest.mark.parametrize("delay_s", [0.0, 0.1, 0.4, 0.6, 1.2])
def test_a_drive_finds_the_delay_of_its_world(delay_s: float) -> None:
    world = lake(delay_s)
    policy = Ahead(world)
    drive(policy, world, Scenario("lake", 1, laps=0.15, speed=12))
    assert policy.latencies[0] == 0.0, "a drive starts without the last one's latency"
    # Frames are 0.06 or 0.08 s apart, so that no report tells 0.08 s from 0.1 s.
    assert np.abs(np.array(policy.latencies[60:]) - delay_s).max() < 0.021


def test_a_policy_that_does_not_predict_ahead_needs_no_meter() -> None:
    policy = as_policy(lambda frame, mph: (0.0, None))
    assert latency_meter(policy) is None
    assert latency_meter(PolicyWrapper(policy)) is None


def test_the_latency_stays_while_the_steering_is_constant(commands: list[float]) -> None:
    meter = LatencyMeter(Ahead())
    feed(meter, [0.3] * 100, 5)
    assert meter.policy.latency_s <= 0.5
    feed(meter, commands, 4, begin=100)
    for row in range(160, 2000):
        meter.report(0.1, row / 10)
        meter.send(0.1)
    assert meter.policy.latency_s == 0.3


def test_the_latency_stays_while_nothing_explains_the_reports(commands: list[float]) -> None:
    meter = LatencyMeter(Ahead())
    feed(meter, commands, 4)
    other = np.random.default_rng(1).uniform(-0.2, 0.2, 600)
    for row, steering in enumerate(other):
        meter.report(float(steering), 6 + row / 10)
        meter.send(float(-other[row // 2]))
    assert meter.policy.latency_s == 0.3


def test_a_policy_is_told_the_commands_on_their_way(commands: list[float]) -> None:
    policy = Ahead()
    meter = LatencyMeter(policy)
    feed(meter, commands, 4)
    meter.report(commands[-4], 6.0)
    assert policy.latency_s == 0.3
    assert policy.expected == np.repeat(commands[-3:], 5).tolist()
    meter.restart()
    meter.report(0.5, 6.0)
    meter.send(0.7)
    meter.report(0.5, 6.1)
    assert policy.expected == [0.5] * 10 + [0.7] * 5, "the older commands are forgotten"


def test_the_latency_survives_that_the_car_is_put_back(commands: list[float]) -> None:
    meter = LatencyMeter(Ahead())
    feed(meter, commands, 5)
    for begin in (60, 70, 80):
        meter.restart()
        feed(meter, commands[:10], 5, begin)
        assert meter.policy.latency_s == 0.4


@pytest.mark.parametrize("rate", [15, 43])
@pytest.mark.parametrize("delay_s", [0.0, 0.2, 0.6])
def test_jitter_of_messages_is_no_obstacle(delay_s: float, rate: int) -> None:
    rng = np.random.default_rng(2)
    meter = LatencyMeter(Ahead())
    sent, steering, time_s = [(-9.0, 0.0)], 0.0, 0.0
    while time_s < 20:
        wheel = sent[bisect.bisect(sent, (time_s - delay_s, math.inf)) - 1][1]
        arrived_s = time_s + rng.uniform(0.002, 0.006)
        meter.report(round(wheel, 4), arrived_s)
        steering = 0.9 * steering + rng.normal(0, 0.02)
        meter.send(steering)
        sent.append((arrived_s + 0.004, steering))
        time_s += rng.uniform(0.9, 1.1) / rate
    assert meter.policy.latency_s == pytest.approx(delay_s, abs=0.021)

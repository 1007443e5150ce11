"""Ensembles as a policy: mean, spread, and the state and the latency of their members."""

import math

import numpy as np
import pytest

from datamodules.view import View
from zoo.checkpoints.command import Command, Policy
from zoo.checkpoints.ensemble_policy import EnsemblePolicy

FRAME = np.zeros((160, 320, 3), np.uint8)


class Member(Policy):
    """A policy with a fixed command."""

    view, config, name, parameters = View((60, 25), "rgb", None), {"seed": 1}, "Member", 10
    takes_speed, outputs = False, 1

    def __init__(self, steering: float, throttle: float | None = None, spread: float | None = None):
        self.command = Command(steering, throttle, spread)
        self.data: dict = {"rows": 3}

    def __call__(self, frame: np.ndarray, speed_mph: float) -> Command:
        return self.command


class Counting(Member):
    """A policy with a state: it steers by the number of frames since its reset."""

    def __init__(self) -> None:
        super().__init__(0.0)
        self.count, self.latency_s = 0, 0.0

    def __call__(self, frame: np.ndarray, speed_mph: float) -> Command:
        self.count += 1
        return Command(self.count / 10)

    def reset(self) -> None:
        self.count = 0

    def session(self) -> "Counting":
        return Counting()


def test_the_command_is_the_mean_with_the_deviation_of_the_members() -> None:
    command = EnsemblePolicy([Member(0.1, 0.5), Member(0.3, 0.7)])(FRAME, 9.0)
    found = (command.steering, command.throttle, command.spread)
    assert found == pytest.approx((0.2, 0.6, 0.1))


def test_the_members_own_variance_counts() -> None:
    command = EnsemblePolicy([Member(0.1, spread=0.2), Member(0.3, spread=0.4)])(FRAME, 9.0)
    assert command.spread == pytest.approx(math.sqrt(0.1**2 + (0.2**2 + 0.4**2) / 2))


def test_without_a_throttle_of_every_member_there_is_none() -> None:
    assert EnsemblePolicy([Member(0.1, 0.5), Member(0.3)])(FRAME, 9.0).throttle is None


def test_a_member_that_steers_nan_makes_the_mean_nan() -> None:
    assert math.isnan(EnsemblePolicy([Member(math.nan), Member(0.3)])(FRAME, 9.0).steering)


def test_it_describes_its_members() -> None:
    policy = EnsemblePolicy([Member(0.1), Member(0.2)])
    assert (policy.name, policy.parameters, policy.data) == ("2 Member", 20, {"rows": 3})
    assert policy.config == {"seed": 1, "model": {"name": "2 Member"}}
    policy.members[1].data = {"rows": 4}
    assert EnsemblePolicy(policy.members).data == {}


def test_members_that_remember_are_reset_and_have_a_state_for_each_session() -> None:
    policy = EnsemblePolicy([Counting(), Member(0.0)])
    other = policy.session()
    assert [policy(FRAME, 9.0).steering for _ in range(2)] == [0.05, 0.1]
    assert other(FRAME, 9.0).steering == 0.05
    policy.reset()
    assert policy(FRAME, 9.0).steering == 0.05


def test_the_latency_reaches_the_members_that_predict_ahead() -> None:
    policy = EnsemblePolicy([Counting(), Member(0.0)])
    policy.latency_s = 0.4
    assert policy.members[0].latency_s == policy.latency_s == 0.4
    assert policy.members[1].latency_s is None
    assert EnsemblePolicy([Member(0.0)]).latency_s is None

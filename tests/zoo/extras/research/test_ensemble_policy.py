"""Ensembles and dropout samples as policies: what all policies promise, and their mean."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from datamodules.view import View
from tests.contracts import test_policies as contract
from tests.zoo.checkpoints import test_engine as engines
from tests.zoo.written_checkpoints import write_pilotnet
from zoo.base.rig import CURVATURE, UDACITY, Camera, single_camera_rig
from zoo.checkpoints import engine
from zoo.checkpoints.checkpoint import load_checkpoint
from zoo.checkpoints.checkpoint_policy import CheckpointPolicy
from zoo.checkpoints.policy_base import Command, Policy, PolicyWrapper
from zoo.driving.drive_loop import drive
from zoo.driving.open_world import open_world
from zoo.driving.scenario import Scenario
from zoo.extras.research.doubt_policy import DropoutPolicy, EnsemblePolicy

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


class Ahead(Member):
    """A policy that predicts ahead."""

    latency_s = 0.0


def test_the_command_is_the_mean_with_the_deviation_of_the_members() -> None:
    command = EnsemblePolicy([Member(0.1, 0.5), Member(0.3, 0.7)])(FRAME, 9.0)
    values = (command.steering, command.throttle, command.spread)
    assert values == pytest.approx((0.2, 0.6, 0.1))
    assert EnsemblePolicy([Member(0.1, 0.5), Member(0.3)])(FRAME, 9.0).throttle is None
    assert math.isnan(EnsemblePolicy([Member(math.nan), Member(0.3)])(FRAME, 9.0).steering)


def test_the_members_own_variance_counts() -> None:
    command = EnsemblePolicy([Member(0.1, spread=0.2), Member(0.3, spread=0.4)])(FRAME, 9.0)
    assert command.spread == pytest.approx(math.sqrt(0.1**2 + (0.2**2 + 0.4**2) / 2))


def test_it_describes_its_members() -> None:
    policy = EnsemblePolicy([Member(0.1), Member(0.2)])
    assert (policy.name, policy.parameters, policy.data) == ("2 Member", 20, {"rows": 3})
    assert policy.config == {"seed": 1, "model": {"name": "2 Member"}}
    for rows, member in enumerate(policy.members):
        member.data = {"rows": rows, "source": "donkeycar"}
    assert EnsemblePolicy(policy.members).data == {"source": "donkeycar"}
    policy.members[0].data = {"source": "my car"}
    assert EnsemblePolicy(policy.members).data == {"source": "my car and donkeycar"}
    assert EnsemblePolicy([*policy.members, Member(0.1)]).data["source"].startswith("my car and d")


def test_the_latency_reaches_the_members_that_predict_ahead() -> None:
    policy = EnsemblePolicy([Ahead(0.0), Member(0.0)])
    policy.latency_s = 0.4
    assert policy.members[0].latency_s == policy.latency_s == 0.4
    assert policy.members[1].latency_s is None
    assert EnsemblePolicy([Member(0.0)]).latency_s is None


SCALE = 0.2


class Bend(Policy):
    """A policy whose network always returns the same label."""

    data = {CURVATURE: SCALE}  # noqa: RUF012

    def __call__(self, frame: object, speed_mph: float) -> Command:
        return self.for_car(Command(0.3))


def test_a_drive_tells_each_member_the_car_of_its_world() -> None:
    members = [Bend(), Bend()]
    for member in members:
        member.rig = single_camera_rig("short", Camera(0, 1.2, 0), 1.0, 60.0)
    world = open_world(Scenario("lake"), "none")
    driven = drive(EnsemblePolicy(members), world, Scenario("lake", laps=0.01))
    assert driven.rows[0].steering == pytest.approx(UDACITY.steering_of(0.3 * SCALE))


def dropout(folder: Path) -> Policy:
    return DropoutPolicy(load_checkpoint(write_pilotnet(folder / "best.ckpt")), 4, seed=0)


def ensemble(folder: Path) -> Policy:
    return EnsemblePolicy([contract.of_model("action_chunk"), contract.of_model("lenet")])


@pytest.mark.parametrize("maker", [dropout, ensemble])
def test_they_are_policies(maker: Callable[[Path], Policy], tmp_path: Path) -> None:
    policy = maker(tmp_path)
    contract.check_commands(policy)
    contract.check_facts(policy)


def test_an_ensemble_is_wrapped(tmp_path: Path) -> None:
    contract.check_wrapper(PolicyWrapper, ensemble(tmp_path))


def test_they_compute_in_double_precision() -> None:
    pilotnet = engines.checkpoint_of("nvidia")
    engines.check_scored(DropoutPolicy(pilotnet, samples=3, seed=1))
    members = [CheckpointPolicy(network) for network in (engines.checkpoint_of("lenet"), pilotnet)]
    engines.check_scored(EnsemblePolicy(members))


def test_onnxruntime_runs_dropout_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engine, "LEAST_OPERATIONS", 0)
    pilotnet = engines.checkpoint_of("nvidia")
    engines.check_engines([DropoutPolicy(pilotnet, 3, 0, name) for name in ("torch", "auto")])

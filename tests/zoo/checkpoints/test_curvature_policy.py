"""Policies of networks whose output is a curvature, in cars of different rigs."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from zoo.base.errors import UsageError
from zoo.base.rig import CURVATURE, UDACITY, Camera, single_camera_rig
from zoo.checkpoints.checkpoint import Checkpoint, load_checkpoint
from zoo.checkpoints.command import Command, Policy
from zoo.checkpoints.doubt_policy import EnsemblePolicy
from zoo.checkpoints.onnx_policy import OnnxPolicy
from zoo.checkpoints.policy import CheckpointPolicy
from zoo.export.onnx_file import onnx_bytes
from zoo.worlds.drive_loop import drive
from zoo.worlds.open_world import open_world
from zoo.worlds.scenario import Scenario

SHORT = single_camera_rig("short", Camera(0, 1.2, 0), wheelbase_m=1.0, steering_deg=60.0)
SCALE = 0.2


@pytest.fixture(scope="module")
def checkpoint(run_folder: Path) -> Checkpoint:
    """Return a checkpoint whose output counts as a curvature."""
    found = load_checkpoint(run_folder)
    return replace(found, data=found.data | {CURVATURE: SCALE})


@pytest.fixture
def frame() -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (160, 320, 3), np.uint8)


@pytest.mark.parametrize("rig", [UDACITY, SHORT], ids=lambda rig: rig.name)
def test_the_command_is_the_steering_of_the_driven_car(checkpoint, frame, rig) -> None:
    output = CheckpointPolicy(replace(checkpoint, data={}))(frame, 9.0).steering
    policy = CheckpointPolicy(checkpoint)
    policy.rig = rig
    assert rig.curvature(policy(frame, 9.0).steering) == pytest.approx(SCALE * output)
    assert output != 0


def test_an_onnx_file_steers_as_its_checkpoint(checkpoint, frame, tmp_path: Path) -> None:
    (tmp_path / "model.onnx").write_bytes(onnx_bytes(checkpoint))
    policies = [CheckpointPolicy(checkpoint), OnnxPolicy(tmp_path / "model.onnx")]
    for policy in policies:
        policy.rig = SHORT
    expected, found = (policy(frame, 9.0).steering for policy in policies)
    assert found == pytest.approx(expected, abs=1e-5)
    import onnx

    assert f"in {SCALE} 1/m" in onnx.load(tmp_path / "model.onnx").doc_string


def test_a_car_of_unknown_rig_is_refused_with_the_key(checkpoint, frame) -> None:
    policy = CheckpointPolicy(checkpoint)
    policy.rig = None
    with pytest.raises(UsageError, match=r"data.label=curvature.*rig.yaml.*data.label=steering"):
        policy(frame, 9.0)


def test_a_spread_becomes_one_of_the_steering() -> None:
    policy = Policy()
    policy.data = {CURVATURE: float(UDACITY.curvature(1.0))}
    policy.rig = replace(UDACITY, steering_deg=12.5)
    found = policy.for_car(Command(0.1, spread=0.05))
    assert found.spread == pytest.approx(0.05 * found.steering / 0.1, rel=0.02)


class Bend(Policy):
    """A policy whose network always returns the same label."""

    data = {CURVATURE: SCALE}  # noqa: RUF012

    def __call__(self, frame: object, speed_mph: float) -> Command:
        return self.for_car(Command(0.3))


def test_a_drive_tells_each_member_the_car_of_its_world() -> None:
    members = [Bend(), Bend()]
    for member in members:
        member.rig = SHORT
    world = open_world(Scenario("lake"), "none")
    driven = drive(EnsemblePolicy(members), world, Scenario("lake", laps=0.01))
    assert driven.rows[0].steering == pytest.approx(UDACITY.steering_of(0.3 * SCALE))

"""The engine that runs a network: torch or onnxruntime, by time and only if both steer the same."""

import sys

import numpy as np
import pytest

from tests.zoo.models.test_memory import NAMES
from tests.zoo.written_checkpoints import checkpoint_of
from zoo.base.errors import InputError
from zoo.checkpoints import engine
from zoo.checkpoints.checkpoint_policy import CheckpointPolicy
from zoo.checkpoints.policy_base import Policy

FRAMES = np.random.default_rng(3).integers(0, 256, (4, 160, 320, 3), np.uint8)


@pytest.fixture
def large(monkeypatch: pytest.MonkeyPatch) -> None:
    """Count every network as one that onnxruntime runs."""
    monkeypatch.setattr(engine, "LEAST_OPERATIONS", 0)


@pytest.mark.parametrize("name", ["lenet", "nvidia_speed", *NAMES])
def test_onnxruntime_steers_as_torch(name: str, large: None) -> None:
    checkpoint = checkpoint_of(name, *(["model.sequence=4"] if name in NAMES else []))
    check_engines([CheckpointPolicy(checkpoint, engine) for engine in ("torch", "auto")])


def check_engines(both: list[Policy]) -> None:
    """Check that a policy of torch and one of onnxruntime steer the same."""
    assert [dict(one.engine) for one in both] == [{"name": "torch"}, {"name": "onnx"}]
    assert [engine.engine_text(one.engine) for one in both] == ["", "engine onnx"]
    for frame in FRAMES:
        ours, theirs = (one(frame, 9.0) for one in both)
        assert ours.steering == pytest.approx(theirs.steering, abs=1e-5)
        assert (ours.throttle is None) == (theirs.throttle is None)


@pytest.mark.parametrize(
    ("name", "runs"), [("nvidia", "torch"), ("lenet", "torch"), ("efficientnet_lite0", "onnx")]
)
def test_the_operations_of_a_frame_choose(name: str, runs: str) -> None:
    assert CheckpointPolicy(checkpoint_of(name), "auto").engine == {"name": runs}


def test_without_onnxruntime_torch_drives(large: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    policy = CheckpointPolicy(checkpoint_of("lenet"), "auto")
    assert policy.engine["name"] == "torch"
    assert "pip install 'drivezoo[onnx]'" in engine.engine_text(policy.engine)
    with pytest.raises(InputError, match=r"engine=onnx: .*pip install 'drivezoo\[onnx\]'"):
        CheckpointPolicy(checkpoint_of("lenet"), "onnx")


def test_an_engine_that_steers_differently_does_not_drive(
    large: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    write, other = engine.graph_bytes, checkpoint_of("lenet", seed=2)
    monkeypatch.setattr(engine, "graph_bytes", lambda _, **keys: write(other, **keys))
    policy = CheckpointPolicy(checkpoint_of("lenet"), "auto")
    assert policy.engine["name"] == "torch"
    assert "more than 0.0001" in policy.engine["note"]
    with pytest.raises(InputError, match=r"engine=onnx: .*0\.0001.*engine=torch"):
        CheckpointPolicy(checkpoint_of("lenet"), "onnx")

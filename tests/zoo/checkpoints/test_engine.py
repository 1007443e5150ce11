"""The engine that runs a network, torch or onnxruntime, and double precision of scored drives."""

import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from datamodules.view import View
from tests.slow_members import slow_but
from tests.zoo.models.test_memory import NAMES
from tests.zoo.written_checkpoints import checkpoint_of
from zoo.base.compose import choices
from zoo.base.errors import InputError
from zoo.checkpoints import engine
from zoo.checkpoints.checkpoint import Checkpoint
from zoo.checkpoints.checkpoint_policy import CheckpointPolicy
from zoo.checkpoints.onnx_file import onnx_bytes
from zoo.checkpoints.onnx_policy import OnnxPolicy
from zoo.checkpoints.policy_base import Policy, PolicyWrapper, as_policy

ZOO = [name for name in choices("model") if name != "vgg"]
DEEP = ("keras", "efficientnet_lite0")  # their sums differ more in single precision
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
    assert [dict(policy.engine) for policy in both] == [{"name": "torch"}, {"name": "onnx"}]
    assert [engine.engine_text(policy.engine) for policy in both] == ["", "engine onnx"]
    for frame in FRAMES:
        ours, theirs = (policy(frame, 9.0) for policy in both)
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
    assert 'pip install "drivezoo[onnx]"' in engine.engine_text(policy.engine)
    with pytest.raises(InputError, match=r'engine=onnx: .*pip install "drivezoo\[onnx\]"'):
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


def commands(policy: Policy) -> np.ndarray:
    return np.array([policy(frame, 9.0).steering for frame in FRAMES])


@pytest.mark.parametrize("name", slow_but({*ZOO} - {"efficientnet_lite0"}, ZOO))
def test_every_network_of_the_zoo_is_scored_in_double_precision(name: str) -> None:
    policy = CheckpointPolicy(checkpoint_of(name))
    scored = policy.scored()
    assert (policy.tied, scored.tied) == ("computes in single precision", "")
    ours, theirs = commands(scored), commands(policy)
    assert np.allclose(ours, theirs, rtol=0, atol=1e-5 if name in DEEP else 1e-6)
    assert (ours == ours.astype(np.float32)).all()
    assert (commands(policy.scored()) == ours).all(), "each session begins without memory"
    assert (commands(policy.session()) == theirs).all(), "the policy itself is as it was"


def test_a_wrapper_is_scored_in_double_precision() -> None:
    check_scored(PolicyWrapper(CheckpointPolicy(checkpoint_of("lenet"))))


def check_scored(policy: Policy) -> None:
    """Check that a policy has a session that computes in double precision."""
    scored = policy.scored()
    assert scored is not policy
    assert policy.tied == "computes in single precision"
    assert scored.tied == ""
    assert np.allclose(commands(scored), commands(policy), atol=1e-5)


class Single(nn.Linear):
    """A network that takes no other numbers than those of single precision."""

    takes_speed, outputs = False, 1

    def forward(self, images: Tensor) -> Tensor:
        return super().forward(images.float().mean((2, 3)) / 255)


def test_a_network_that_refuses_drives_as_it_is_and_says_so() -> None:
    policy = CheckpointPolicy(Checkpoint(Single(3, 1), View([60, 20], "rgb", None), {}, {}))
    scored = policy.scored()
    assert "Single computes in single precision alone" in scored.tied
    assert (commands(scored) == commands(policy)).all()


def test_what_drivezoo_does_not_compute_is_tied(tmp_path: Path) -> None:
    path = tmp_path / "lenet.onnx"
    path.write_bytes(onnx_bytes(checkpoint_of("lenet")))
    assert "onnxruntime" in OnnxPolicy(path).scored().tied
    assert "function" in as_policy(lambda frame, mph: (0.0, None)).scored().tied


def test_what_overflows_single_precision_is_nan_as_in_driving() -> None:
    checkpoint = checkpoint_of("lenet")
    with torch.no_grad():
        for parameter in checkpoint.network.parameters():
            parameter.copy_(1e30 * torch.sign(parameter))
    assert np.isnan(commands(CheckpointPolicy(checkpoint).scored())).all()

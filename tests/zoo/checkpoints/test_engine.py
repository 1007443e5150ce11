"""The engine that runs a network: torch or onnxruntime, by time and only if both steer the same."""

import sys
from dataclasses import replace

import numpy as np
import pytest
import torch

from tests.zoo.models.test_memory import NAMES
from tests.zoo.models.test_models_command import build
from zoo.base.errors import InputError
from zoo.checkpoints import engine
from zoo.checkpoints.checkpoint import Checkpoint
from zoo.checkpoints.doubt_policy import DropoutPolicy
from zoo.checkpoints.policy import CheckpointPolicy

FRAMES = np.random.default_rng(3).integers(0, 256, (4, 160, 320, 3), np.uint8)


def checkpoint_of(name: str, seed: int = 1) -> Checkpoint:
    torch.manual_seed(seed)
    network, view = build(name, *(["model.sequence=4"] if name in NAMES else []))
    return Checkpoint(network.eval(), view, {}, {"rows_per_s": 15.0})


@pytest.fixture
def slow_torch(monkeypatch: pytest.MonkeyPatch) -> None:
    times = {"torch": 20.0, "onnx": 10.0}
    monkeypatch.setattr(engine, "_shortest_ms", lambda found, _: {one: times[one] for one in found})


@pytest.mark.parametrize("name", ["lenet", "nvidia_speed", *NAMES, "dropout"])
def test_the_faster_engine_steers_as_the_other(name: str, slow_torch: None) -> None:
    if name == "dropout":
        both = [DropoutPolicy(checkpoint_of("nvidia"), 3, 0, one) for one in ("torch", "auto")]
    else:
        both = [CheckpointPolicy(checkpoint_of(name), one) for one in ("torch", "auto")]
    assert [dict(one.engine) for one in both] == [
        {"name": "torch"},
        {"name": "onnx", "ms": {"torch": 20.0, "onnx": 10.0}},
    ]
    for frame in FRAMES:
        ours, theirs = (one(frame, 9.0) for one in both)
        assert ours.steering == pytest.approx(theirs.steering, abs=1e-5)
        assert (ours.throttle is None) == (theirs.throttle is None)


def test_a_quick_network_is_not_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engine, "graph_bytes", None)
    monkeypatch.setattr(engine, "QUICK_MS", 1e6)
    policy = CheckpointPolicy(checkpoint_of("lenet"), "auto")
    assert list(policy.engine["ms"]) == ["torch"]
    assert "note" not in policy.engine
    assert engine.engine_text(policy.engine).startswith("engine torch (torch ")


def test_without_onnxruntime_torch_drives(
    slow_torch: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    policy = CheckpointPolicy(checkpoint_of("lenet"), "auto")
    assert policy.engine["name"] == "torch"
    assert "pip install 'drivezoo[onnx]'" in engine.engine_text(policy.engine)
    with pytest.raises(InputError, match=r"engine=onnx: .*pip install 'drivezoo\[onnx\]'"):
        CheckpointPolicy(checkpoint_of("lenet"), "onnx")


def test_an_engine_that_steers_differently_does_not_drive(
    slow_torch: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    write, other = engine.graph_bytes, checkpoint_of("lenet", seed=2)
    monkeypatch.setattr(
        engine,
        "graph_bytes",
        lambda one, **keys: write(replace(one, network=other.network), **keys),
    )
    policy = CheckpointPolicy(checkpoint_of("lenet"), "auto")
    assert policy.engine["name"] == "torch"
    assert "more than 0.0001" in policy.engine["note"]
    with pytest.raises(InputError, match=r"engine=onnx: .*0\.0001.*engine=torch"):
        CheckpointPolicy(checkpoint_of("lenet"), "onnx")

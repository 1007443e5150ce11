"""What every policy promises, over all implementations."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.zoo.models.test_memory import NAMES
from tests.zoo.models.test_models_command import build
from tests.zoo.written_checkpoints import write_pilotnet
from zoo.base.rig import UDACITY
from zoo.checkpoints.checkpoint import Checkpoint, load_checkpoint
from zoo.checkpoints.checkpoint_policy import CheckpointPolicy, load_policy
from zoo.checkpoints.doubt_policy import DropoutPolicy, EnsemblePolicy
from zoo.checkpoints.onnx_file import onnx_bytes
from zoo.checkpoints.policy_base import Command, Policy, PolicyWrapper, as_policy
from zoo.driving.embedded_world import open_embedded
from zoo.driving.scenario import Scenario
from zoo.training.collecting import LabellingPolicy

FRAMES = np.random.default_rng(3).integers(0, 256, (4, 160, 320, 3), np.uint8)
FACTS = (
    "name",
    "parameters",
    "outputs",
    "takes_speed",
    "predicts_spread",
    "latency_s",
    "view",
    "config",
    "data",
    "engine",
)


def of_model(name: str) -> CheckpointPolicy:
    torch.manual_seed(1)
    network, view = build(name, *(["model.sequence=4"] if name in NAMES else []))
    return CheckpointPolicy(Checkpoint(network.eval(), view, {}, {"rows_per_s": 15.0}))


def labelling(policy: Policy) -> Policy:
    world = open_embedded(Scenario("lake"), "none").simulated
    return LabellingPolicy(policy, world, 15.0, beta=0.0, nudge=0.0, seed=0)


def exported(folder: Path) -> Policy:
    pytest.importorskip("onnxruntime")
    checkpoint = load_checkpoint(write_pilotnet(folder / "best.ckpt"))
    (folder / "model.onnx").write_bytes(onnx_bytes(checkpoint))
    return load_policy(folder / "model.onnx")


def ensemble() -> Policy:
    return EnsemblePolicy([of_model("action_chunk"), of_model("lenet")])


def dropout(folder: Path) -> Policy:
    return DropoutPolicy(load_checkpoint(write_pilotnet(folder / "best.ckpt")), 4, seed=0)


POLICIES: dict[str, Callable[[Path], Policy]] = {
    "checkpoint": lambda folder: of_model("lenet"),
    **{name: lambda folder, name=name: of_model(name) for name in NAMES},
    "onnx": exported,
    "dropout": dropout,
    "ensemble": lambda folder: ensemble(),
    "function": lambda folder: as_policy(lambda frame, mph: (frame.mean() / 255, None)),
}
WRAPPERS: dict[str, Callable[[Policy], Policy]] = {
    "labels": labelling,
    "wrapper": PolicyWrapper,
}


def steering(policy: Policy) -> list[float]:
    return [policy(frame, 9.0).steering for frame in FRAMES]


@pytest.mark.parametrize("name", POLICIES)
def test_a_policy_commands_forgets_and_has_sessions(name: str, tmp_path: Path) -> None:
    policy = POLICIES[name](tmp_path)
    command = policy(FRAMES[0], 9.0)
    assert isinstance(command, Command)
    assert -1 <= command.steering <= 1
    assert (command.spread is not None) == policy.predicts_spread
    policy.reset()
    first = steering(policy)
    assert name not in NAMES or steering(policy)[0] != first[0], "it has no memory"
    policy.reset()
    assert steering(policy) == first
    one, other = policy.session(), policy.session()
    assert isinstance(one, Policy)
    for number, frame in enumerate(FRAMES):  # in turns, each car with its own frames
        assert one(frame, 9.0).steering == first[number]
        other(FRAMES[-1 - number], 9.0)


@pytest.mark.parametrize("name", POLICIES)
def test_a_policy_states_its_facts(name: str, tmp_path: Path) -> None:
    policy = POLICIES[name](tmp_path)
    assert policy.name
    assert policy.outputs in (1, 2)
    assert policy.parameters >= 0
    assert all(isinstance(one, Policy) for one in policy.members)
    assert dict(policy.config) == policy.config
    assert dict(policy.data) == policy.data
    assert (policy.latency_s is not None) == (name in ("action_chunk", "ensemble"))
    if policy.latency_s is not None:
        policy.latency_s = 0.2
        assert policy.latency_s == 0.2
    policy.expect(np.zeros(3))


@pytest.mark.parametrize("wrap", WRAPPERS)
def test_a_wrapper_forwards_all_methods_and_facts(wrap: str) -> None:
    policy = ensemble().in_car(UDACITY)
    wrapper = WRAPPERS[wrap](policy)
    wrapper.reset()
    first = steering(wrapper)
    wrapper.reset()
    assert steering(wrapper) == first
    wrapper.latency_s = 0.4
    for fact in FACTS:
        assert getattr(wrapper, fact) == getattr(policy, fact), fact
    assert policy.latency_s == 0.4
    assert wrapper.members == policy.members
    late = []
    for steered in (-0.5, 0.5):
        wrapper.reset()
        wrapper.expect(np.full(20, steered))
        late.append(wrapper(FRAMES[0], 9.0).steering)
    assert late[0] != late[1], "the policy knows nothing of the commands on their way"
    assert wrapper.session().policy is not policy


@pytest.mark.parametrize("wrap", WRAPPERS)
def test_a_wrapper_of_a_function_does_not_predict_ahead(wrap: str) -> None:
    policy = as_policy(lambda frame, mph: Command(0.0, None, 0.1))
    assert WRAPPERS[wrap](policy).latency_s is None

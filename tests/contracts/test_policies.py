"""What every policy promises, over all implementations."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.contracts.outside_package import installed, manual_example
from tests.zoo.models.test_memory import NAMES
from tests.zoo.written_checkpoints import checkpoint_of, write_pilotnet
from zoo.base.errors import InputError
from zoo.base.rig import UDACITY
from zoo.checkpoints import policy_kinds
from zoo.checkpoints.checkpoint import load_checkpoint
from zoo.checkpoints.checkpoint_policy import CheckpointPolicy, load_policy
from zoo.checkpoints.onnx_file import onnx_bytes
from zoo.checkpoints.policy_base import Command, Policy, PolicyWrapper, as_policy
from zoo.checkpoints.policy_kinds import policy_kind

FRAMES = np.random.default_rng(3).integers(0, 256, (4, 160, 320, 3), np.uint8)
FACTS = (
    *("name", "parameters", "outputs", "takes_speed", "predicts_spread"),
    *("latency_s", "view", "config", "data", "engine"),
)


def of_model(name: str) -> CheckpointPolicy:
    return CheckpointPolicy(checkpoint_of(name, *(["model.sequence=4"] if name in NAMES else [])))


def exported(folder: Path) -> Policy:
    pytest.importorskip("onnxruntime")
    checkpoint = load_checkpoint(write_pilotnet(folder / "best.ckpt"))
    (folder / "model.onnx").write_bytes(onnx_bytes(checkpoint))
    return load_policy(folder / "model.onnx")


POLICIES: dict[str, Callable[[Path], Policy]] = {
    "checkpoint": lambda folder: of_model("lenet"),
    **{name: lambda folder, name=name: of_model(name) for name in NAMES},
    "onnx": exported,
    "function": lambda folder: as_policy(lambda frame, mph: (frame.mean() / 255, None)),
}


def steering(policy: Policy) -> list[float]:
    return [policy(frame, 9.0).steering for frame in FRAMES]


@pytest.mark.parametrize("name", POLICIES)
def test_a_policy_has_commands_memory_sessions_and_facts(name: str, tmp_path: Path) -> None:
    policy = POLICIES[name](tmp_path)
    check_commands(policy, has_memory=name in NAMES)
    check_facts(policy)


def check_commands(policy: Policy, has_memory: bool = False) -> None:
    """Check a policy's commands, its memory, and that each car has one of its own."""
    command = policy(FRAMES[0], 9.0)
    assert isinstance(command, Command)
    assert -1 <= command.steering <= 1
    assert (command.spread is not None) == policy.predicts_spread
    policy.reset()
    first = steering(policy)
    assert not has_memory or steering(policy)[0] != first[0], "it has no memory"
    policy.reset()
    assert steering(policy) == first
    first_car, second_car = policy.session(), policy.session()
    assert isinstance(first_car, Policy)
    for number, frame in enumerate(FRAMES):  # in turns, each car with its own frames
        assert first_car(frame, 9.0).steering == first[number]
        second_car(FRAMES[-1 - number], 9.0)


def check_facts(policy: Policy) -> None:
    """Check the facts that a policy states about itself."""
    assert policy.name
    assert policy.outputs in (1, 2)
    assert policy.parameters >= 0
    assert all(isinstance(member, Policy) for member in policy.members)
    assert (dict(policy.config), dict(policy.data)) == (policy.config, policy.data)
    ahead = [member for member in policy.members if member.name == "ActionChunk"]
    assert (policy.latency_s is not None) == bool(ahead)
    if policy.latency_s is not None:
        policy.latency_s = 0.2
        assert policy.latency_s == 0.2
    policy.expect(np.zeros(3))


def test_a_file_of_an_installed_kind_drives(tmp_path: Path) -> None:
    path = tmp_path / "table.ckpt"
    torch.save({"steering": torch.linspace(-1, 1, 256)}, path)
    with installed(tmp_path / "site", manual_example("my_policies.py"), "drivezoo.policies"):
        check_commands(load_policy(path))
        check_facts(load_policy(path))
        with pytest.raises(InputError, match=r"table\.ckpt: is a table of steering, .* name a"):
            load_checkpoint(path)
        torch.save({"steering": torch.zeros(3)}, path)
        with pytest.raises(InputError, match=r"table\.ckpt: steering: needs 256 values"):
            load_policy(path)
    with pytest.raises(InputError, match=r"table\.ckpt: "):
        load_policy(path)


def test_a_missing_kind_names_those_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(policy_kinds, "installed_entries", lambda group: [])
    torch.save({"drivezoo": {"format": 1, "other": {}}, "members": []}, tmp_path / "x.ckpt")
    with pytest.raises(InputError, match=r"x\.ckpt: .*installed kind of policy \(none\)"):
        load_policy(tmp_path / "x.ckpt")


@pytest.mark.parametrize("contents", [None, 1, [], {}, {"drivezoo": 1}, {"drivezoo": {"doubt": 1}}])
def test_no_kind_takes_what_nobody_wrote(contents: object) -> None:
    assert policy_kind(contents) is None


def test_a_wrapper_forwards_all_methods_and_facts() -> None:
    check_wrapper(PolicyWrapper, of_model("action_chunk"))


def check_wrapper(wrap: Callable[[Policy], PolicyWrapper], policy: Policy) -> None:
    """Check that a wrapper of a policy that predicts ahead has its methods and facts."""
    policy.in_car(UDACITY)
    wrapper = wrap(policy)
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
    assert wrap(as_policy(lambda frame, mph: Command(0.0, None, 0.1))).latency_s is None

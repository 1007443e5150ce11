"""Policies of a checkpoint, a function or an ensemble: the forward pass, memory, car."""

import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from datamodules.view import View
from tests.zoo.written_checkpoints import checkpoint_of
from zoo.base.compose import choices
from zoo.base.errors import UsageError
from zoo.base.rig import CURVATURE, UDACITY, Camera, single_camera_rig
from zoo.checkpoints.checkpoint import Checkpoint, load_checkpoint
from zoo.checkpoints.checkpoint_policy import CheckpointPolicy
from zoo.checkpoints.frozen_graph import network_inputs, quick_forward
from zoo.checkpoints.onnx_file import onnx_bytes
from zoo.checkpoints.onnx_policy import OnnxPolicy
from zoo.checkpoints.policy_base import Command, Policy, as_policy
from zoo.driving.drive_loop import drive
from zoo.driving.open_world import open_world
from zoo.driving.scenario import Scenario
from zoo.models.lenet import LeNet
from zoo.models.memory import Memory
from zoo.models.network_facts import facts_of
from zoo.models.pilotnet import PilotNet

# Not vgg, which takes seconds, nor efficientnet_lite0: a frozen graph folds batch normalization,
# which is not equal to the bit.
MODELS = [name for name in choices("model") if name not in ("vgg", "efficientnet_lite0")]
SPEED = 20.0
WHOLE = View((60, 25), "rgb", None)  # without a smaller size


@pytest.mark.parametrize("name", MODELS)
def test_a_networks_outputs_stay_the_same_to_the_bit(name: str) -> None:
    checkpoint = checkpoint_of(name)
    network, view = checkpoint.network, checkpoint.view
    images = np.random.default_rng(1).integers(0, 256, (5, *view.shape), np.uint8)
    frames = [
        network_inputs(image, SPEED if facts_of(network).takes_speed else None) for image in images
    ]
    wanted = outputs_of(network, network, frames)
    forward = quick_forward(network, view)
    assert isinstance(forward, torch.jit.ScriptModule)
    assert all(map(torch.equal, outputs_of(network, forward, frames), wanted))


@torch.inference_mode()
def outputs_of(network: nn.Module, forward: Callable, frames: list[tuple]) -> list[Tensor]:
    """Return the outputs for frames, one after the other; with the state of one with memory."""
    if not isinstance(network, Memory):
        return [forward(*frame) for frame in frames]
    forward = network.step if forward is network else forward
    outs, state = [], network.first_state()
    for frame in frames:
        out, *state = forward(*frame, *state)
        outs.append(out)
    return outs


class Moody(LeNet):
    """A network whose branch depends on the image, which one traced graph cannot repeat."""

    def forward(self, images: Tensor) -> Tensor:
        out = super().forward(images)
        return -out if float(images.float().mean()) > self.threshold else out


def test_a_network_that_no_graph_repeats_drives_as_it_is() -> None:
    network = Moody((3, 75, 320)).eval()
    images = np.random.default_rng(0).integers(0, 256, (3, *WHOLE.shape), np.uint8)
    network.threshold = float(np.sort([image.mean() for image in images])[:2].mean())
    assert quick_forward(network, WHOLE) is network
    assert all(tensor.is_contiguous() for tensor in network.parameters())


class Failing(nn.Module):
    def forward(self, images: Tensor) -> Tensor:
        if torch.jit.is_tracing():
            raise RuntimeError("not so")
        return images.float().mean((1, 2, 3))[:, None]


def test_a_network_that_cannot_be_traced_drives_as_it_is() -> None:
    network = Failing()
    assert quick_forward(network, WHOLE) is network


def test_a_newer_torch_prints_no_warning_of_its_tracer(monkeypatch: pytest.MonkeyPatch) -> None:
    freeze = torch.jit.freeze

    def freeze_as_in_2_15(*arguments: object) -> object:
        text = "`torch.jit.freeze` is deprecated. Please use `torch.compile` instead."
        warnings.warn(text, FutureWarning, stacklevel=2)
        return freeze(*arguments)

    monkeypatch.setattr(torch.jit, "freeze", freeze_as_in_2_15)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        forward = quick_forward(LeNet((3, 75, 320)).eval(), WHOLE)
    assert isinstance(forward, torch.jit.ScriptModule)
    assert not caught


def test_a_torch_without_torchscript_drives_with_the_network(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delattr(torch.jit, "trace")
    network = LeNet((3, 75, 320)).eval()
    assert quick_forward(network, WHOLE) is network
    assert next(network.parameters()).is_contiguous(memory_format=torch.channels_last)


@pytest.mark.parametrize("speed", [False, True], ids=["steering", "steering and throttle"])
def test_a_network_that_predicts_its_spread_returns_it(speed: bool) -> None:
    view = View((40, 20), "rgb", (66, 200))
    torch.manual_seed(1)
    network = PilotNet((3, 66, 200), spread=True, speed=speed).eval()
    with torch.no_grad():
        network.head[-2].weight[0] *= 100  # steers beyond 1
    policy = CheckpointPolicy(Checkpoint(network, view, {}, {}))
    frame = np.random.default_rng(0).integers(0, 256, (160, 320, 3), np.uint8)
    out = network(*network_inputs(view(frame), SPEED if speed else None))[0].tolist()

    command = policy(frame, SPEED)

    assert command.steering == min(max(out[0], -1), 1)
    assert command.throttle == (min(max(out[1], -1), 1) if speed else None)
    assert command.spread == pytest.approx(np.exp(out[-1]))
    assert policy.outputs == 1 + speed


class Counting(Policy):
    """A policy that turns off the road, and counts resets."""

    resets = 0

    def __call__(self, frame, speed_mph: float) -> Command:
        return Command(0.5)

    def reset(self) -> None:
        self.resets += 1


def test_a_pair_and_a_command_stand_for_each_other() -> None:
    assert as_policy(lambda frame, mph: (0.1, None))(None, 9.0) == Command(0.1, None, None)
    steering, throttle = Command(0.1, 0.2, spread=0.3)
    assert (steering, throttle) == (0.1, 0.2) == tuple(Command(0.1, 0.2))
    assert Command(0.1, 0.2)[0] == 0.1


def test_a_drive_resets_the_policy_at_its_start_and_after_each_intervention() -> None:
    policy, scenario = Counting(), Scenario("lake", 1, laps=0.1, speed=9.0)
    driven = drive(policy, open_world(scenario, "none"), scenario)
    assert driven.intervention.sum() > 1
    assert policy.resets == 1 + driven.intervention.sum()


FRAMES = np.random.default_rng(3).integers(0, 256, (6, 160, 320, 3), np.uint8)


def policy_of(name: str, *overrides: str) -> CheckpointPolicy:
    return CheckpointPolicy(checkpoint_of(name, *overrides))


def steering(policy: CheckpointPolicy, frames: np.ndarray = FRAMES) -> list[float]:
    return [policy(frame, 9.0).steering for frame in frames]


def test_with_a_stride_each_state_sees_every_second_frame() -> None:
    policy = policy_of("cnn_gru", "model.stride=2")
    even, odd = policy_of("cnn_gru"), policy_of("cnn_gru")
    wanted = [0.0] * len(FRAMES)
    wanted[0::2], wanted[1::2] = steering(even, FRAMES[0::2]), steering(odd, FRAMES[1::2])
    assert steering(policy) == wanted


def test_the_steering_is_that_of_the_time_at_which_it_reaches_the_wheels() -> None:
    policy = policy_of("action_chunk", "model.ahead=3", "model.stride=3")
    with torch.no_grad():
        images = torch.from_numpy(policy.view(FRAMES[0])).permute(2, 0, 1)[None]
        steps = policy.network.step(images, *policy.network.first_state())[0][0, :, 0]
    now, *later = steps.clamp(-1, 1).tolist()
    assert policy.latency_s == 0.0
    asked = {0.0: now, 0.2: later[0], 0.3: (later[0] + later[1]) / 2, 0.6: later[2], 9.0: later[2]}
    for latency_s, wanted in asked.items():
        policy.latency_s = latency_s
        policy.reset()
        assert policy(FRAMES[0], 9.0).steering == pytest.approx(wanted, abs=1e-6)


def test_without_the_recordings_rate_the_latency_changes_nothing() -> None:
    policy = CheckpointPolicy(replace(checkpoint_of("action_chunk"), data={}))
    before = policy(FRAMES[0], 9.0)
    policy.latency_s = 0.5
    assert policy(FRAMES[0], 9.0) == before


SHORT = single_camera_rig("short", Camera(0, 1.2, 0), wheelbase_m=1.0, steering_deg=60.0)
SCALE = 0.2


@pytest.fixture(scope="module")
def checkpoint(run_folder: Path) -> Checkpoint:
    """Return a checkpoint whose output counts as a curvature."""
    original = load_checkpoint(run_folder)
    return replace(original, data=original.data | {CURVATURE: SCALE})


@pytest.mark.parametrize("rig", [UDACITY, SHORT], ids=lambda rig: rig.name)
def test_the_command_is_the_steering_of_the_driven_car(checkpoint, rig) -> None:
    output = CheckpointPolicy(replace(checkpoint, data={}))(FRAMES[0], 9.0).steering
    policy = CheckpointPolicy(checkpoint)
    policy.rig = rig
    assert rig.curvature(policy(FRAMES[0], 9.0).steering) == pytest.approx(SCALE * output)
    assert output != 0


def test_an_onnx_file_steers_as_its_checkpoint(checkpoint, tmp_path: Path) -> None:
    (tmp_path / "model.onnx").write_bytes(onnx_bytes(checkpoint))
    policies = [CheckpointPolicy(checkpoint), OnnxPolicy(tmp_path / "model.onnx")]
    for policy in policies:
        policy.rig = SHORT
    expected, steered = (policy(FRAMES[0], 9.0).steering for policy in policies)
    assert steered == pytest.approx(expected, abs=1e-5)
    import onnx

    assert f"in {SCALE} 1/m" in onnx.load(tmp_path / "model.onnx").doc_string


def test_a_car_of_unknown_rig_is_refused_with_the_key(checkpoint) -> None:
    policy = CheckpointPolicy(checkpoint)
    policy.rig = None
    with pytest.raises(UsageError, match=r"data.label=curvature.*rig.yaml.*data.label=steering"):
        policy(FRAMES[0], 9.0)


def test_a_spread_becomes_one_of_the_steering() -> None:
    policy = Policy()
    policy.data = {CURVATURE: float(UDACITY.curvature(1.0))}
    policy.rig = replace(UDACITY, steering_deg=12.5)
    command = policy.for_car(Command(0.1, spread=0.05))
    assert command.spread == pytest.approx(0.05 * command.steering / 0.1, rel=0.02)

"""A policy's quick forward pass: the network's, to the bit."""

import warnings
from collections.abc import Callable

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from datamodules.view import View
from tests.zoo.compositions import composed
from zoo.checkpoints.checkpoint import Checkpoint
from zoo.checkpoints.frozen_graph import network_inputs, quick_forward
from zoo.checkpoints.policy import CheckpointPolicy
from zoo.cli.compose import choices
from zoo.models.lenet import LeNet
from zoo.models.make_network import make_network
from zoo.models.memory import Memory
from zoo.models.pilotnet import PilotNet

# Not vgg, which takes seconds, nor efficientnet_lite0: a frozen graph folds batch normalization,
# which is not equal to the bit.
MODELS = [name for name in choices("model") if name not in ("vgg", "efficientnet_lite0")]
SPEED = 20.0


@pytest.mark.parametrize("name", MODELS)
def test_a_networks_outputs_stay_the_same_to_the_bit(name: str) -> None:
    config = composed(f"model={name}")
    model = config["model"]
    view = View(config["data"]["crop"], model["colour"], model["size"])
    torch.manual_seed(1)
    network = make_network(model, view).eval()
    pictures = np.random.default_rng(1).integers(0, 256, (5, *view.shape), np.uint8)
    frames = [network_inputs(one, SPEED if network.takes_speed else None) for one in pictures]
    wanted = outputs_of(network, network, frames)
    forward = quick_forward(network, view)
    assert isinstance(forward, torch.jit.ScriptModule)
    assert all(map(torch.equal, outputs_of(network, forward, frames), wanted))


@torch.inference_mode()
def outputs_of(network: nn.Module, forward: Callable, frames: list[tuple]) -> list[Tensor]:
    """Return the outputs for frames, one after the other; with the state of one with memory."""
    if not isinstance(network, Memory):
        return [forward(*one) for one in frames]
    forward = network.step if forward is network else forward
    outs, state = [], network.first_state()
    for one in frames:
        out, *state = forward(*one, *state)
        outs.append(out)
    return outs


class Moody(LeNet):
    """A network whose branch depends on the image, which one traced graph cannot repeat."""

    def forward(self, images: Tensor) -> Tensor:
        out = super().forward(images)
        return -out if float(images.float().mean()) > self.threshold else out


def test_a_network_that_no_graph_repeats_drives_as_it_is() -> None:
    view = View((60, 25), "rgb", None)
    network = Moody((3, 75, 320)).eval()
    pictures = np.random.default_rng(0).integers(0, 256, (3, *view.shape), np.uint8)
    network.threshold = float(np.sort([one.mean() for one in pictures])[:2].mean())
    assert quick_forward(network, view) is network
    assert all(one.is_contiguous() for one in network.parameters())


class Failing(nn.Module):
    takes_speed, outputs = False, 1

    def forward(self, images: Tensor) -> Tensor:
        if torch.jit.is_tracing():
            raise RuntimeError("not so")
        return images.float().mean((1, 2, 3))[:, None]


def test_a_network_that_cannot_be_traced_drives_as_it_is() -> None:
    network = Failing()
    assert quick_forward(network, View((60, 25), "rgb", None)) is network


def test_a_newer_torch_prints_no_warning_of_its_tracer(monkeypatch: pytest.MonkeyPatch) -> None:
    freeze = torch.jit.freeze

    def freeze_as_in_2_15(*arguments: object) -> object:
        text = "`torch.jit.freeze` is deprecated. Please use `torch.compile` instead."
        warnings.warn(text, FutureWarning, stacklevel=2)
        return freeze(*arguments)

    monkeypatch.setattr(torch.jit, "freeze", freeze_as_in_2_15)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        forward = quick_forward(LeNet((3, 75, 320)).eval(), View((60, 25), "rgb", None))
    assert isinstance(forward, torch.jit.ScriptModule)
    assert not caught


def test_a_torch_without_torchscript_drives_with_the_network(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delattr(torch.jit, "trace")
    network = LeNet((3, 75, 320)).eval()
    assert quick_forward(network, View((60, 25), "rgb", None)) is network
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

"""A network's forward pass on one frame, as fast as torch can compute the same output."""

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from datamodules.view import View
from zoo.models.memory import Memory, Step


def network_inputs(view_image: np.ndarray, speed_mph: float | None) -> tuple[Tensor, ...]:
    """Return a network's inputs for one frame, in the memory layout of training.

    Args:
        view_image: image after the view, uint8 [H, W, C].
        speed_mph: speed in mph, for a network that takes it; else None.
    """
    images = torch.from_numpy(view_image[None]).permute(0, 3, 1, 2)
    return (images,) if speed_mph is None else (images, torch.tensor([speed_mph]).float())


def quick_forward(network: nn.Module, view: View) -> Callable[..., Any]:
    """Return a network's frozen graph, or the network if their outputs are not equal to the bit.

    For a network with memory the graph is that of its `step`.

    For one frame, Python between the layers and copies of the weights into another layout take a
    large part of the time. The frozen graph takes 0.69 of the network's time for PilotNet, 0.68 for
    LeNet and 0.52 for tiny (medians of 600, interleaved, one thread of two busy cores of an AMD
    EPYC).
    """
    step = Step(network) if isinstance(network, Memory) else network
    with warnings.catch_warnings():
        # Deprecated, but the output of `torch.export` is slower than the network.
        warnings.simplefilter("ignore", DeprecationWarning)
        warnings.simplefilter("ignore", torch.jit.TracerWarning)  # the size is always the view's
        try:
            inputs, wanted = _trials(network, step, view)
            # The images' layout; values stay. (torch's type stubs lack memory_format alone.)
            network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
            with torch.no_grad():
                traced = torch.jit.trace(step, inputs[0], check_trace=False)
            frozen = torch.jit.freeze(traced)
            with torch.inference_mode():  # torch optimizes the graph in its first runs
                outs = [_tensors(frozen(*one)) for one in inputs]
            same = all(
                torch.equal(*pair)
                for out, one in zip(outs, wanted, strict=True)
                for pair in zip(out, one, strict=True)
            )
        except Exception:  # the network does something that a graph cannot
            same = False
    if same:
        return frozen
    network.to(memory_format=torch.contiguous_format)  # type: ignore[call-overload]
    return step


@torch.inference_mode()
def _trials(
    network: nn.Module, step: nn.Module, view: View
) -> tuple[list[tuple[Tensor, ...]], list[tuple[Tensor, ...]]]:
    """Return the inputs and outputs of three frames of noise, one after the other."""
    speed = 20.0 if network.takes_speed else None
    images = np.random.default_rng(0).integers(0, 256, (3, *view.shape), np.uint8)
    state = network.first_state() if isinstance(network, Memory) else ()
    inputs, wanted = [], []
    for image in images:
        inputs.append((*network_inputs(image, speed), *state))
        wanted.append(_tensors(step(*inputs[-1])))
        state = wanted[-1][1:]
    return inputs, wanted


def _tensors(outputs: Tensor | tuple[Tensor, ...]) -> tuple[Tensor, ...]:
    return (outputs,) if isinstance(outputs, Tensor) else outputs

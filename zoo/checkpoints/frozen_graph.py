"""A checkpoint's network in a policy: its facts, and a fast forward pass of the same output."""

import copy
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar

import numpy as np
import torch
from torch import Tensor, nn

from datamodules.view import View
from zoo.checkpoints.checkpoint import Checkpoint
from zoo.checkpoints.policy_base import Policy
from zoo.models.memory import Memory, Step
from zoo.models.network_facts import facts_of


def network_inputs(view_image: np.ndarray, speed_mph: float | None) -> tuple[Tensor, ...]:
    """Return a network's inputs for one frame, in the memory layout of training.

    Args:
        view_image: image after the view, uint8 [H, W, C].
        speed_mph: speed in mph, for a network that takes it; else None.
    """
    images = torch.from_numpy(view_image[None]).permute(0, 3, 1, 2)
    return (images,) if speed_mph is None else (images, torch.tensor([speed_mph]).float())


@contextmanager
def quiet_tracing() -> Iterator[None]:
    """Ignore the warnings of torch's tracer, which concern no user."""
    with warnings.catch_warnings():
        # DeprecationWarning up to PyTorch 2.14, FutureWarning from 2.15 on.
        warnings.filterwarnings("ignore", message=r"`torch\.jit\.\w+` is (deprecated|not supp)")
        warnings.simplefilter("ignore", torch.jit.TracerWarning)  # the size is always the view's
        yield


def quick_forward(network: nn.Module, view: View) -> Callable[..., Any]:
    """Return a network's frozen graph, or the network if their outputs are not equal to the bit.

    For a network with memory the graph is that of its `step`. Without TorchScript, which PyTorch
    2.15 deprecates, the network itself computes in the images' layout.

    For one frame, Python between the layers and copies of the weights into another layout take a
    large part of the time. Milliseconds of a core per frame (medians of 300, in turns, PyTorch
    2.15), of the frozen graph, of the network in the images' layout, and of `torch.export`:
    PilotNet 1.89, 2.11, 2.58; LeNet 0.42, 0.48, 0.91; tiny 0.06, 0.08, 0.26.
    """
    step = as_step(network)
    try:
        inputs, wanted = trials(network, step, view)
        # The images' layout; values stay. (torch's type stubs lack memory_format alone.)
        network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        forward: Callable[..., Any] = step
        if hasattr(torch.jit, "trace"):
            with quiet_tracing(), torch.no_grad():
                forward = torch.jit.freeze(torch.jit.trace(step, inputs[0], check_trace=False))
        with torch.inference_mode():  # torch optimizes the graph in its first runs
            same = largest_difference([forward(*row) for row in inputs], wanted) == 0
    except Exception:  # the network does something that a graph cannot
        same = False
    if same:
        return forward
    network.to(memory_format=torch.contiguous_format)  # type: ignore[call-overload]
    return step


def double_forward(network: nn.Module, view: View) -> Callable[..., Any]:
    """Return a function with a network's outputs, computed in double precision.

    The outputs are rounded to single precision, a state is not. In single precision the outputs
    differ between processors by 1e-7, since sums are in another order. In double precision they
    differ by 1e-16, which the rounding hides in all but one of 100 million.

    Raises:
        RuntimeError, TypeError: a layer computes in single precision alone.
    """
    doubled = copy.deepcopy(network).double()
    trials(doubled, as_step(doubled), view)  # raises what `quick_forward` would hide
    forward = quick_forward(doubled, view)

    def rounded(*inputs: Tensor) -> Any:
        doubled = (tensor.double() if tensor.is_floating_point() else tensor for tensor in inputs)
        outputs, *state = tensors(result := forward(*doubled))
        single = outputs.float()
        single = single + 0 * single  # NaN where single precision would have overflowed
        return single if isinstance(result, Tensor) else (single, *state)

    return rounded


def as_step(network: nn.Module) -> nn.Module:
    """Return the step of a network with memory, and any other network as it is."""
    return Step(network) if isinstance(network, Memory) else network


@torch.inference_mode()
def trials(
    network: nn.Module, step: nn.Module, view: View
) -> tuple[list[tuple[Tensor, ...]], list[tuple[Tensor, ...]]]:
    """Return the inputs and outputs of three frames of noise, one after the other."""
    speed = 20.0 if facts_of(network).takes_speed else None
    images = np.random.default_rng(0).integers(0, 256, (3, *view.shape), np.uint8)
    state = network.first_state() if isinstance(network, Memory) else ()
    weight = next(network.parameters(), torch.empty(0))
    inputs, wanted = [], []
    for image in images:
        row = network_inputs(image, speed)
        inputs.append((row[0], *(speeds.to(weight.dtype) for speeds in row[1:]), *state))
        wanted.append(tensors(step(*inputs[-1])))
        state = wanted[-1][1:]
    return inputs, wanted


def tensors(outputs: Tensor | tuple[Tensor, ...]) -> tuple[Tensor, ...]:
    """Return a network's output and the state that its step returns, if it does."""
    return (outputs,) if isinstance(outputs, Tensor) else outputs


def largest_difference(outputs: Sequence[Any], wanted: Sequence[tuple[Tensor, ...]]) -> float:
    """Return the largest difference of outputs and states, over the frames of `trials`."""
    differences = [
        (ours.float() - theirs.float()).abs().max()
        for out, expected in zip(outputs, wanted, strict=True)
        for ours, theirs in zip(tensors(out), expected, strict=True)
    ]
    return float(torch.stack(differences).max())


Network = TypeVar("Network", bound="NetworkPolicy")  # typing.Self needs Python 3.11


class NetworkPolicy(Policy):
    """A policy with the network of a checkpoint and its facts, as in `OnnxPolicy`.

    Args:
        checkpoint: checkpoint with the network.

    Attributes:
        network: network in evaluation mode, on the CPU; must not be changed.
    """

    tied = "computes in single precision"
    forward: Callable[..., Any]

    def __init__(self, checkpoint: Checkpoint) -> None:
        self.network, self.view = checkpoint.network, checkpoint.view
        self.config, self.data = checkpoint.config, checkpoint.data
        self.name = type(self.network).__name__
        self.parameters = sum(parameter.numel() for parameter in self.network.parameters())
        facts = facts_of(self.network)
        self.takes_speed, self.outputs = facts.takes_speed, facts.outputs
        self.predicts_spread = facts.predicts_spread
        self._doubled: list[Callable[..., Any]] = []  # shared by all sessions

    def in_double(self: Network, network: nn.Module) -> Network:
        """Return a session that computes `network` as `double_forward` does, if that can be."""
        other: Any = copy.copy(self.session())
        try:
            if not self._doubled:
                self._doubled.append(double_forward(network, self.view))
        except (RuntimeError, TypeError) as error:  # of torch, at a layer
            reason = f"{self.name} computes in single precision alone"
            other.tied = f"{reason} ({' '.join(str(error).split()):.100})"
        else:
            other.forward, other.tied = self._doubled[0], ""
        return other

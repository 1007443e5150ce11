"""A network's forward pass on one frame, as quick as torch makes it without other results."""

import warnings
from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor, nn

from datamodules.view import View


def network_inputs(picture: np.ndarray, speed_mph: float | None) -> tuple[Tensor, ...]:
    """Return a view, uint8 [H, W, C], as a batch of one, and the speed for a network that takes it.

    The batch is laid out as in training.
    """
    images = torch.from_numpy(picture[None]).permute(0, 3, 1, 2)
    return (images,) if speed_mph is None else (images, torch.tensor([speed_mph]).float())


def quick_forward(network: nn.Module, view: View) -> Callable[..., Tensor]:
    """Return the network as a frozen graph if its outputs are equal to the bit, else the network.

    Sooner, because a frame is so little work that Python between the layers, and copies that lay
    the weights out again for each frame, take a large part of it: a forward pass takes 0.69 of the
    time for PilotNet, 0.68 for LeNet and 0.52 for tiny (medians of 600, interleaved, one thread of
    two busy cores of an AMD EPYC).
    """
    speed = 20.0 if network.takes_speed else None
    pictures = np.random.default_rng(0).integers(0, 256, (3, *view.shape), np.uint8)
    inputs = [network_inputs(picture, speed) for picture in pictures]
    with warnings.catch_warnings():
        # Deprecated, and not replaced: what `torch.export` makes is slower than the network.
        warnings.simplefilter("ignore", DeprecationWarning)
        warnings.simplefilter("ignore", torch.jit.TracerWarning)  # the size is always the view's
        try:
            with torch.inference_mode():
                wanted = [network(*one) for one in inputs]
            # As the pictures are; values stay. (torch's overloads lack memory_format alone.)
            network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
            with torch.no_grad():
                traced = torch.jit.trace(network, inputs[0], check_trace=False)
            frozen = torch.jit.freeze(traced)
            with torch.inference_mode():  # the graph is arranged while it runs for the first times
                outs = [frozen(*one) for one in inputs]
            same = all(map(torch.equal, outs, wanted))
        except Exception:  # whatever a network does that no graph can
            same = False
    if same:
        return frozen
    network.to(memory_format=torch.contiguous_format)  # type: ignore[call-overload]
    return network

"""Facts about a network: its multiply-adds and its source."""

import inspect
import sys

import torch
from torch.utils.flop_counter import FlopCounterMode

from zoo.models.memory import frame_outputs


def multiply_adds(network: torch.nn.Module, shape: tuple[int, int, int]) -> int:
    """Return the multiply-adds of convolutions and dense layers for one frame."""
    images, speed = torch.zeros(1, *shape), torch.zeros(1)
    network.eval()
    with torch.no_grad(), FlopCounterMode(display=False) as counter:
        frame_outputs(network, images, speed)
    return counter.get_total_flops() // 2


def paper(network: torch.nn.Module) -> str:
    """Return the first line of the docstring of a network's module, which names its source."""
    text = inspect.getdoc(sys.modules[type(network).__module__])
    return text.splitlines()[0].rstrip(".") if text else "no source named"

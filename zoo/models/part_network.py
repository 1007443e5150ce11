"""Check of a network that a user's part defines, before it is trained or drives."""

import torch
from torch import nn

from zoo.base.errors import InputError
from zoo.cli.parts import Part, part_errors
from zoo.models.memory import Memory

FRAMES = 2  # more than one: a missing dimension would otherwise be broadcast


def check_network(network: nn.Module, shape: tuple[int, int, int], part: Part) -> None:
    """Raise InputError if a network lacks what training and driving need of it.

    Args:
        network: network of the part.
        shape: `(channels, height, width)` of its view.
        part: part that defines it, for messages.
    """
    name = type(network).__name__
    for key, kind, example in (("takes_speed", bool, "False"), ("outputs", int, "1")):
        if not isinstance(getattr(network, key, None), kind):
            raise InputError(f"{part.name}: {name} lacks {key}; add {key} = {example} to the class")
    if isinstance(network, Memory):  # its own methods compute the shapes
        return
    inputs = [torch.zeros(FRAMES, *shape)]
    if network.takes_speed:
        inputs.append(torch.zeros(FRAMES))
    was_training = network.training
    with part_errors(part), torch.no_grad():
        found = network.eval()(*inputs)
    network.train(was_training)
    columns = network.outputs + bool(getattr(network, "predicts_spread", False))
    if not isinstance(found, torch.Tensor) or tuple(found.shape) != (FRAMES, columns):
        shown = list(found.shape) if isinstance(found, torch.Tensor) else type(found).__name__
        raise InputError(
            f"{part.name}: {name}.forward returns {shown} for {FRAMES} images; return "
            f"[{FRAMES}, {columns}], one row for each image"
        )

"""A network's outputs for a batch, and the true outputs to compare them with."""

from collections.abc import Callable
from typing import Any

from torch import Tensor, nn

from datamodules.batches import Batch
from zoo.models.memory import Memory
from zoo.models.network_facts import facts_of


def predictor(network: nn.Module, skips_front: bool = False) -> Callable[[Batch], Tensor]:
    """Return a function from a batch to a network's outputs, [N, outputs], steering first.

    A network with memory has outputs for K rows of each window, [N, K, outputs].

    Args:
        network: network of the zoo, or of a part.
        skips_front: whether batches hold features of the frozen layers in place of images.
    """
    takes_speed, has_memory = facts_of(network).takes_speed, isinstance(network, Memory)
    rest: Any = network.rest if skips_front else None

    def predict(batch: Batch) -> Tensor:
        images = batch["images"]
        if skips_front:
            return rest(images)
        if takes_speed:
            return network(images, batch["speed"])
        if has_memory and images.ndim == 4:  # windows of one frame
            images = images[:, None]
        return network(images)

    return predict


def true_outputs(network: nn.Module) -> Callable[[Batch], Tensor]:
    """Return a function from a batch to the true outputs of all rows that a network predicts.

    They are [rows, outputs].
    """
    outputs = facts_of(network).outputs
    rows = network.targets if isinstance(network, Memory) else None

    def select(batch: Batch) -> Tensor:
        targets = batch["targets"]
        if rows is not None:
            targets = targets[:, None] if targets.ndim == 2 else targets
            targets = targets[:, rows].flatten(0, 1)
        return targets[:, :outputs]

    return select

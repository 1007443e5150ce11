"""What a step of Lightning's does with a batch: the interface, and one batch on one process.

The other ways are subclasses, one in each file: `group_step`, `captured_step` and `rank_step`. How
the loss of a batch is computed does not concern them: `batch_outputs` and `compiled_loss` do that.
"""

from collections.abc import Callable
from typing import Protocol

import lightning
import numpy as np
from torch import Tensor, nn

from datamodules.batches import Batch

BatchLoss = Callable[[Batch], Tensor]  # mean loss of a batch, as a scalar


def as_group(batch: Batch | list[Batch]) -> list[Batch]:
    """Return what a loader gave as a list: it gives a batch, or a group of batches."""
    return batch if isinstance(batch, list) else [batch]


class StepModule(Protocol):
    """What a step needs of the module that trains, see `SteeringModule`."""

    trainer: lightning.Trainer
    network: nn.Module
    loss: nn.Module

    def targets_of(self, batch: Batch) -> Tensor:
        """Return the targets of the loss."""


class BatchStep:
    """A step of Lightning's by the loss of one batch, and the mean loss of an epoch.

    Args:
        module: module that trains, with the optimizers of its trainer.
        batch_loss: function from a batch to its loss.

    Attributes:
        by_lightning: whether Lightning's own optimizer step follows.
        samples: number of samples of the epoch so far, of all processes.
    """

    by_lightning = True

    def __init__(self, module: StepModule, batch_loss: BatchLoss) -> None:
        self.module, self.batch_loss = module, batch_loss
        self.start_epoch()

    def start_epoch(self) -> None:
        """Start the sums of an epoch."""
        self.loss_sum: Tensor | float = 0.0
        self.samples: Tensor | int = 0

    def step_ahead(self, group: list[Batch]) -> None:
        """Take the optimizer steps that come before Lightning's own; here none."""

    def loss(self, group: list[Batch]) -> Tensor | None:
        """Return the loss by which Lightning's optimizer step is taken; count it."""
        batch = group[-1]
        loss = self.batch_loss(batch)
        self.count(loss.detach(), len(batch["images"]))
        return loss

    def count(self, loss: Tensor, samples: Tensor | int) -> None:
        """Add the mean loss of a number of samples to the epoch's."""
        # Not summed in place: a compiled step owns the loss that it returns.
        self.loss_sum = self.loss_sum + loss * samples
        self.samples = self.samples + samples

    def mean_loss(self) -> Tensor | float:
        """Return the mean loss of the epoch so far, over all processes' samples."""
        return self.loss_sum / self.samples

    def is_finite(self) -> bool:
        """Return whether the losses are finite; waits for the steps that a GPU has not taken."""
        return bool(np.isfinite(float(self.loss_sum)))

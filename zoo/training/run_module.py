"""What a training run needs of a LightningModule."""

from collections.abc import Sequence

import lightning
import numpy as np
from torch import nn


class RunModule(lightning.LightningModule):
    """A LightningModule that a run trains; a class that has these members, too, is one.

    `forward(batch)` returns the outputs of a batch, steering first. It logs what checkpoints and
    early stopping monitor: `val/mse`.

    Args:
        network: network that drives; its weights are saved and evaluated.
        card: plain containers that every checkpoint holds (see `zoo.checkpoints.checkpoint`). A
            constructor may take the other arguments of `SteeringModule`, too.

    Attributes:
        train_epochs, train_samples, train_seconds: of this process's training; 0 if not counted.
        validation: predicted and true steering of the last validation, to plot; None for none.
    """

    FIGURES = ("train_epochs", "train_samples", "train_seconds", "validation")
    NEEDED = (*FIGURES, "mean_loss", "on_save_checkpoint")
    train_epochs, train_samples, train_seconds = 0, 0, 0.0
    validation: Sequence[np.ndarray] | None = None

    def __init__(self, network: nn.Module, card: dict | None = None) -> None:
        super().__init__()
        self.network, self.card = network, card or {}

    def mean_loss(self) -> float:
        """Return the mean loss of the epoch so far; of the epoch before, as logged, by default."""
        return float(self.trainer.callback_metrics.get("train/loss", float("nan")))

    def on_save_checkpoint(self, checkpoint: dict) -> None:
        """Add the card to the checkpoint."""
        checkpoint["drivezoo"] = self.card

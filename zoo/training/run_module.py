"""What a training run needs of Lightning's module and Trainer."""

from collections.abc import Sequence

import lightning
import numpy as np
from lightning import Callback, Trainer
from lightning.pytorch.profilers import Profiler
from torch import nn

from datamodules.run_data import RunData


class RunModule(lightning.LightningModule):
    """A LightningModule that a run trains; a class that has these members, too, is one.

    `forward(batch)` returns the outputs of a batch, steering first. It logs what checkpoints and
    early stopping monitor: `val/mse`.

    Args:
        network: network that drives; its weights are saved and evaluated.
        card: plain containers that every checkpoint holds (see `zoo.checkpoints.checkpoint`). A
            constructor may take the other arguments of `SteeringModule`, too.

    Attributes:
        train_epochs, train_samples, train_seconds: of the training so far; 0 if not counted.
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


# Lightning sets what follows on a Trainer from outside the class, so that its type lacks it.
def callbacks_of(trainer: Trainer) -> list[Callback]:
    """Return the callbacks of a trainer, to which more can be appended."""
    return trainer.callbacks  # type: ignore[attr-defined]


def profiler_of(trainer: Trainer) -> Profiler:
    """Return the profiler of a trainer, which may measure nothing."""
    return trainer.profiler  # type: ignore[attr-defined]


def is_trial(trainer: Trainer) -> bool:
    """Return whether a trainer only tries its code, with `trainer.fast_dev_run`."""
    return bool(trainer.fast_dev_run)  # type: ignore[attr-defined]


def data_of(trainer: Trainer) -> RunData:
    """Return the datamodule with which a trainer fits."""
    return trainer.datamodule  # type: ignore[attr-defined]

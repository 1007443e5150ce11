"""What a training run needs of a datamodule."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import lightning

from datamodules.windows import Windows
from zoo.base.rig import STEERING

if TYPE_CHECKING:
    import numpy as np
    import torch
    from rich.console import Console

    from datamodules.batches import EvaluationBatches
    from datamodules.recording import Recording
    from datamodules.split import Split
    from datamodules.view import View


class RunData(lightning.LightningDataModule):
    """A LightningDataModule with which a run trains; a class that has these members, too, is one.

    Besides Lightning's `train_dataloader` and `val_dataloader`, whose batches the module takes, it
    needs two methods of its own: `load(console)`, which reads the recording before anything else
    is called, or returns the datamodule that has read it, and `evaluation_batches(part)`, which
    returns the `EvaluationBatches` of `train`, `val` or `test`. The members below have defaults.

    Attributes:
        recording, split, view: what `load` leaves: the `Recording`, its `Split`, the network's
            `View`.
        label, windows, batch_size, split_by: unit of the steering, frames of a sample, samples of
            a batch, and the split in words.
    """

    NEEDED = ("load", "evaluation_batches", "train_dataloader", "val_dataloader")
    LOADED = ("recording", "split", "view")
    load: "Callable[[Console], RunData | None]"
    evaluation_batches: "Callable[[str], EvaluationBatches]"
    recording: "Recording"
    split: "Split"
    view: "View"
    label: Any = STEERING
    windows: Any = Windows()
    batch_size: Any = 1
    split_by: Any = "its datamodule"

    def steering_of(self, rows: "np.ndarray") -> "np.ndarray":
        """Return the true steering of rows."""
        return self.recording.steering[rows]

    def count_samples(self) -> int:
        """Return the number of training samples."""
        return len(self.split.train)

    def epoch_samples(self) -> int:
        """Return the number of samples of an epoch, with those that fill its last batch."""
        return self.count_samples()

    def choose_batch_device(
        self, device: "torch.device", console: "Console"
    ) -> "torch.device | None":
        """Return the device that creates training batches; None for the CPU."""
        return None

    def with_feed(
        self,
        batch_device: "torch.device | None" = None,
        batches_per_step: int = 1,
        features: Any = None,
    ) -> "RunData":
        """Return the datamodule that feeds batches as the plan of the run says."""
        return self

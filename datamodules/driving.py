"""The datamodule: recordings to batches for training, validation and test."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import torch
from rich.console import Console
from torch.utils.data import BatchSampler, DataLoader, Dataset

from datamodules.augmented_batch import Augment
from datamodules.balance import BalancedBatches, BatchOptions
from datamodules.batches import EvaluationBatches, TrainingBatches, unchanged
from datamodules.device_batches import DeviceBatches
from datamodules.features import FeatureBatches
from datamodules.recording import Recording
from datamodules.row_views import RowViews
from datamodules.run_data import RunData
from datamodules.samples import Samples
from datamodules.split import Split
from datamodules.view import View
from zoo.base.errors import InputError
from zoo.base.process_pool import hidden_script
from zoo.base.rig import SteeringLabel


class TrainingLoader(DataLoader):
    """A DataLoader whose processes do not run the user's script again, see `hidden_script`."""

    def __iter__(self) -> Any:
        """Start the processes, and return an iterator over batches."""
        with hidden_script():
            return super().__iter__()


@dataclass(kw_only=True, eq=False, repr=False)
class DrivingData(RunData):
    """The batches of a recording's training, validation and test rows; see `DataSettings.load`.

    Attributes:
        options: how training batches are drawn and fed.
        recording: recording whose images are decoded.
        labelled: the same recording, with steering in the unit of the labels.
        label: unit of the labels.
        view: view of the network, of the recording's frames.
        views: decoded views of the recording's rows.
        split: rows of each part.
        split_by: split in words.
        samples: training samples.
        augment: augmentation of training images.
        batch_device, batches_per_step, features: see `with_feed`.
    """

    options: BatchOptions
    recording: Recording
    labelled: Recording
    label: SteeringLabel
    view: View
    views: RowViews
    split: Split
    split_by: str
    samples: Samples
    augment: Augment
    batch_device: torch.device | None = None
    batches_per_step: int = 1
    features: RowViews | None = None
    _device_batches: DeviceBatches | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        """Complete Lightning's part."""
        super().__init__()
        most = self.options.samples_per_epoch or len(self.samples)
        self.batch_size, self.windows = min(self.options.batch_size, most), self.samples.windows

    def steering_of(self, rows: np.ndarray) -> np.ndarray:
        """Return the true steering of rows, in the unit of the labels."""
        return self.labelled.steering[rows]

    def count_samples(self) -> int:
        """Return the number of training samples, of all cameras."""
        return len(self.samples)

    def epoch_samples(self) -> int:
        """Return the number of samples of an epoch, with those that fill its last batch."""
        return len(self.sampler()) * self.batch_size

    def sampler(self, rank: int = 0, world: int = 1) -> BalancedBatches:
        """Return the sampler of an epoch's batch keys, of one rank.

        Raises:
            InputError: the cache does not hold the windows that are used at a time.
        """
        options, samples = self.options, self.samples
        balance: dict[str, Any] = {
            "samples_per_epoch": options.samples_per_epoch,
            "straight_cap": options.straight_cap,
            "straight_threshold": options.straight_threshold,
        }
        if options.weights is not None:
            number = self.recording.recording[samples.row]
            balance["weights"] = np.array(options.weights, float)[number]
        if self.views.shards:
            shard = self.views.file[samples.row, samples.camera]
            balance |= {"shard": shard, "window_shards": options.window_shards}
        keys = BalancedBatches(samples, self.batch_size, options.seed, rank, world, **balance)
        remote = [shard for shard in self.views.shards if shard.reader.is_remote]
        largest = max((max(shard.reader.bytes.values()) for shard in remote), default=0)
        window_gb = world * min(options.window_shards, len(remote)) * largest / 1e9
        if window_gb > options.cache_gb:
            raise InputError(
                f"data.cache_gb={options.cache_gb:g}: the windows of data.window_shards="
                f"{options.window_shards} shards of {world} processes take {window_gb:.3g} GB; set "
                f"data.cache_gb={window_gb * 1.01:.3g} or a smaller data.window_shards"
            )
        keys.windows_ahead = int(2 * window_gb <= options.cache_gb)
        return keys

    def training_batches(self) -> TrainingBatches:
        """Return training batches by `BatchKey`, flipped and augmented."""
        flip = 0.0 if self.options.flip == "both" else float(self.options.flip)
        return TrainingBatches(self.views, self.samples, self.augment, flip, self.options.seed)

    def choose_batch_device(self, device: torch.device, console: Console) -> torch.device | None:
        """Return the device that creates training batches, as `augment_on` says; None for the CPU.

        Args:
            device: device that trains.
            console: console for the names of transforms that only the CPU has.

        Raises:
            InputError: `augment_on=device` with a transform that only the CPU has.
        """
        chosen = self.options.augment_on
        if chosen == "cpu" or (chosen == "auto" and device.type == "cpu"):
            return None
        missing = ", ".join(self.augment.cpu_only)
        if missing and chosen == "device":
            raise InputError(
                f"data.augment_on=device: {missing} has no equivalent on the device; leave it out "
                'of "augment=[...]", or set data.augment_on=cpu'
            )
        if missing:
            line = f"augmented on the CPU: the device has no equivalent of {missing}"
            console.print(line, highlight=False)
        return None if missing else device

    def with_feed(
        self,
        batch_device: torch.device | None = None,
        batches_per_step: int = 1,
        features: RowViews | None = None,
    ) -> "DrivingData":
        """Return a copy that shares the loaded data and feeds it in another way.

        Args:
            batch_device: device that creates training batches; None for the CPU.
            batches_per_step: number of training batches in a group; 1 for single batches.
            features: features fed in place of images (`datamodules.features`).
        """
        return replace(
            self, batch_device=batch_device, batches_per_step=batches_per_step, features=features
        )

    def train_dataloader(self) -> DataLoader:
        """Return this rank's training batches."""
        keys: Any = self.sampler(*self._rank())
        if self.trainer is not None:  # a resumed run's first batch comes before Lightning's epoch
            loop: Any = self.trainer.fit_loop
            epochs, batches_done = loop.epoch_progress.current, loop.epoch_loop.batch_progress
            keys.set_epoch(epochs.processed)  # Lightning counts it as completed only later
            if epochs.started > epochs.processed and not batches_done.is_last_batch:
                keys.start = batches_done.current.ready * self.batches_per_step
            keys.fetch_ahead = self.views.fetch_ahead if self.views.shards else None
        training, workers = self.training_batches(), self.options.workers
        batches: Dataset = training
        if self.features is not None:
            batches = FeatureBatches(training, self.features)
        elif self.batch_device is not None:
            batches, workers = DeviceBatches(training, self.batch_device), 0
            self._device_batches = batches
        sampling: dict[str, Any] = {"batch_size": None, "sampler": keys}
        if self.batches_per_step > 1:
            sampling = {"batch_sampler": BatchSampler(keys, self.batches_per_step, drop_last=False)}
        sampling |= {"num_workers": workers, "persistent_workers": workers > 0}
        return TrainingLoader(batches, collate_fn=unchanged, **sampling)

    def transfer_batch_to_device(self, batch: Any, device: torch.device, loader: int) -> Any:
        """Return a batch, or a group of them, on the device, with the images created there."""
        group = batch if isinstance(batch, list) else [batch]
        if self._device_batches and "drawn" in group[0]:
            finished = self._device_batches.finish(group)
            return finished if isinstance(batch, list) else finished[0]
        if device.type == "cpu":  # Lightning would look at each tensor of a group
            return batch
        return super().transfer_batch_to_device(batch, device, loader)

    def evaluation_batches(self, part: str) -> EvaluationBatches:
        """Return all rows of `train`, `val` or `test`, in order; with windows, see `rows`."""
        views = self.views if self.features is None else self.features
        rows = self.windows.past.whole(self.recording, getattr(self.split, part))
        return EvaluationBatches(views, self.labelled, rows, windows=self.windows)

    def val_dataloader(self) -> DataLoader | list:
        """Return this rank's validation rows; `SteeringModule` joins the predictions."""
        batches = self.evaluation_batches("val")
        shard = batches.share(*self._rank()) if self.trainer is not None else batches
        return DataLoader(shard, batch_size=None, shuffle=False) if len(batches) else []

    def test_dataloader(self) -> DataLoader | list:
        """Return the test rows."""
        batches = self.evaluation_batches("test")
        return DataLoader(batches, batch_size=None, shuffle=False) if len(batches) else []

    def _rank(self) -> tuple[int, int]:
        """Return the rank of this process and the number of processes."""
        return (self.trainer.global_rank, self.trainer.world_size) if self.trainer else (0, 1)

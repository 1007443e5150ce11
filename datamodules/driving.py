"""The datamodule: recordings to batches for training, validation and test."""

import copy
import functools
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal, get_type_hints

import numpy as np
import torch
from pydantic import Field
from rich.console import Console
from torch.utils.data import BatchSampler, DataLoader, Dataset

from datamodules.augment import Augment, Change
from datamodules.balance import BalancedBatches
from datamodules.batches import EvaluationBatches, TrainingBatches, unchanged
from datamodules.device_batches import DeviceBatches
from datamodules.driving_log import CAMERAS
from datamodules.features import FeatureBatches
from datamodules.looking.findings import report_lines
from datamodules.looking.leak import Leak, measure_leak, thumbnail
from datamodules.read_options import ReadOptions
from datamodules.recording import Recording
from datamodules.recording_format import read_recordings
from datamodules.row_views import RowViews, load_row_views
from datamodules.run_data import RunData
from datamodules.samples import CENTER, camera_numbers, make_samples
from datamodules.split import PARTS, Split, split_rows, split_words
from datamodules.steering_label import curvature_label, in_label, label_lines
from datamodules.view import View
from datamodules.windows import Windows
from zoo.base.command_keys import convert
from zoo.base.errors import InputError, UsageError, hint
from zoo.base.rig import STEERING, SteeringLabel

MOST_WINDOW = 256  # frames, rows or targets of a window
# Arguments that are checked elsewhere.
UNTYPED = {"root", "view", "weights", "cameras", "augment", "columns", "steering", "each", "read"}
Share = Annotated[float, Field(ge=0, le=1)]
Least0 = Annotated[float, Field(ge=0)]
Count = Annotated[int, Field(ge=1)]


class DrivingData(RunData):
    """The batches of recordings; call `load` before use. The keys of `conf/data` are arguments.

    Args:
        root: the recordings' folder, or a list of them.
        weights: factors by which each recording's training samples are drawn more often.
        label: `steering`, or `curvature` of the car's path, in one unit for all cars.
        view: view of the network (`data.crop`, `model.colour`, `model.size`,
            `model.resize`).
        cameras: names of the cameras to train on.
        offset: steering added for the left camera and subtracted for the right one.
        recover_s: seconds of recovery, from which the offset is derived (see `make_samples`).
        flip: probability of mirroring a sample; or `both`, to feed each sample both ways.
        straight_cap: largest share of nearly straight samples in a batch; None for no limit.
        straight_threshold: absolute steering below which a sample is nearly straight.
        samples_per_epoch: number of samples drawn; None takes each sample once.
        batch_size: samples in a batch, of all processes together.
        split: kind of split or a file, with val_share, test_share, block_s, gap_s and split_seed.
        augment: transforms of `conf/augment`, by name.
        augment_on: `cpu`, or `device`: the device that trains keeps the views, if they fit, and
            augments them; `auto` is `device` if that is no CPU and has all of `augment`.
        window_shards: shards whose images are mixed with each other.
        workers: processes that prepare batches; 0 leaves the cores to the network.
        seed: random seed of order, draws, flips and augmentation.
        sequence: number of frames in a sample's window (see `Windows`); None for 1.
        stride: rows from one frame of a window to the next; None for 1.
        ahead: number of targets after a window's newest frame; None for 0.
        read: keys of `ReadOptions`; `cache` also keeps decoded views, None keeps them in memory.

    Raises:
        InputError: a value is wrong; from `load`, a recording cannot be read.
    """

    def __init__(
        self,
        root: str | list[str] | None,
        view: View,
        weights: list[float] | None = None,
        label: Literal["steering", "curvature"] = "steering",
        cameras: Sequence[str] = CAMERAS,
        offset: Annotated[float, Field(ge=-1, le=1)] = 0.275,
        recover_s: Annotated[float, Field(gt=0)] | None = None,
        flip: Share | Literal["both"] = 0.5,
        straight_cap: Share | None = 0.5,
        straight_threshold: Least0 = 0.1,
        samples_per_epoch: Count | None = None,
        batch_size: Count = 64,
        split: str = "blocks",
        val_share: Least0 = 0.1,
        test_share: Least0 = 0.1,
        block_s: Least0 | None = None,
        gap_s: Least0 | None = None,
        split_seed: int = 0,
        augment: dict | None = None,
        augment_on: Literal["auto", "cpu", "device"] = "auto",
        window_shards: Count = 64,
        workers: Annotated[int, Field(ge=0)] = 0,
        seed: int = 1,
        sequence: Annotated[int, Field(ge=1, le=MOST_WINDOW)] | None = None,
        stride: Annotated[int, Field(ge=1, le=MOST_WINDOW)] | None = None,
        ahead: Annotated[int, Field(ge=0, le=MOST_WINDOW)] | None = None,
        **read: Any,
    ) -> None:
        given = {key: value for key, value in locals().items() if key not in ("self", "__class__")}
        given |= given.pop("read")
        super().__init__()
        if root is None:
            raise InputError("data.root is not set: name your recording, data.root=FOLDER")
        kinds = {
            **get_type_hints(DrivingData.__init__, include_extras=True),
            **get_type_hints(ReadOptions, include_extras=True),
        }
        for key in given.keys() - UNTYPED:
            if key not in kinds:
                near = hint(f"data.{key}", [f"data.{name}" for name in kinds])
                raise UsageError(f"data.{key}: no such key; {near}")
            convert(f"data.{key}", kinds[key], given[key])
        camera_numbers(cameras)
        self.windows = Windows(sequence or 1, stride or 1, ahead or 0)
        self.root, self.view = root, view
        self.read = ReadOptions(**read)
        self.weights = weights
        self.cameras, self.offset, self.recover_s = list(cameras), offset, recover_s
        self.label_kind: str = label
        self.flip, self.batch_size, self.workers, self.seed = flip, batch_size, workers, seed
        self.balance: dict[str, Any] = {
            "samples_per_epoch": samples_per_epoch,
            "straight_cap": straight_cap,
            "straight_threshold": straight_threshold,
        }
        self.split_settings: dict[str, Any] = {
            "kind": split,
            "val_share": val_share,
            "test_share": test_share,
            "block_s": block_s,
            "gap_s": gap_s,
            "seed": split_seed,
        }
        transforms = [transform for transform in (augment or {}).values() if transform]
        self.augment = Augment(transforms, view.colour)
        self.augment_on = augment_on
        self.cache = Path(self.read.cache).expanduser() if self.read.cache else None
        self.window_shards = window_shards
        self._batch_device: torch.device | None = None
        self._device_batches: DeviceBatches | None = None
        self.batches_per_step = 1
        self.features: RowViews | None = None

    def load(self, console: Console) -> None:
        """Read the recordings, decode images that are not cached, and split the rows."""
        recording = read_recordings(self.root, **vars(self.read))
        count = len(recording.names)
        if self.weights is not None and not _are_weights(self.weights, count):
            raise InputError(
                f"data.weights={self.weights} is not null, or a list of {count} numbers above 0, "
                "one for each recording of data.root"
            )
        if size := recording.frame_size():
            self.view = replace(self.view, frame=size)
        # Validation and test always use the centre camera.
        views, faults = load_row_views(
            recording, [*self.cameras, "center"], self.view, self.cache, console
        )
        if faults:
            lines = tuple(f"{recording.place(row)}: {faults[row]}" for row in sorted(faults))
            good = ~np.isin(np.arange(len(recording)), list(faults))
            if self.read.on_bad_image == "fail" or not good.any():
                skip = ", or set data.on_bad_image=skip" if good.any() else ""
                raise InputError(
                    f"{lines[0]} ({len(lines)} of {len(recording)} rows have a bad image); "
                    f"record or copy it again{skip}"
                )
            recording, views = recording.keep(good, lines), views.keep(good)
        for transform in self.augment.transforms:
            if isinstance(transform, Change):
                transform.fit(self.view.crop, recording.rig)
        self.recording: Recording = recording
        self.views: RowViews = views
        self.label: SteeringLabel = STEERING
        if self.label_kind == "curvature":
            self.label = curvature_label(recording)
            self.augment = Augment(self.augment.transforms, self.view.colour, self.label)
        self.labelled = replace(
            recording, steering=in_label(recording, recording.steering, self.label)
        )
        for line in [*report_lines(recording), *label_lines(recording, self.label)]:
            console.print(line, highlight=False, markup=False, emoji=False)
        self.split: Split = split_rows(recording, **self.split_settings)
        settings = self.split_settings
        self.split_by = split_words(
            recording, settings["kind"], settings["block_s"], settings["gap_s"]
        )
        if self.windows.is_windowed:
            console.print(self.windows.line(recording, self.split), highlight=False)
        self.samples = make_samples(
            self.labelled,
            self.windows.whole(recording, self.split.train),
            self.cameras,
            self.offset,
            self.recover_s,
            both_ways=self.flip == "both",
            windows=self.windows,
            label=self.label,
        )
        if self.weights is not None:
            number = recording.recording[self.samples.row]
            self.balance["weights"] = np.array(self.weights, float)[number]
        if views.shards:
            shard = views.file[self.samples.row, self.samples.camera]
            self.balance |= {"shard": shard, "window_shards": self.window_shards}
        count = self.balance["samples_per_epoch"] or len(self.samples)
        if self.batch_size > count:
            line = f"data.batch_size={self.batch_size}: there are {count} training samples"
            console.print(f"{line}, which are one batch", highlight=False)
            self.batch_size = count
        next(iter(self.sampler()))  # to report a wrong straight_cap now

    def steering_of(self, rows: np.ndarray) -> np.ndarray:
        """Return the true steering of rows, in the unit of the labels."""
        return self.labelled.steering[rows]

    def count_samples(self) -> int:
        """Return the number of training samples, of all cameras."""
        return len(self.samples)

    def sampler(self, rank: int = 0, world: int = 1) -> BalancedBatches:
        """Return the sampler of an epoch's batch keys, of one rank.

        Raises:
            InputError: the cache does not hold the windows that are used at a time.
        """
        keys = BalancedBatches(
            self.samples, self.batch_size, self.seed, rank, world, **self.balance
        )
        remote = [one for one in self.views.shards if one.reader.is_remote]
        largest = max((max(one.reader.bytes.values()) for one in remote), default=0)
        window_gb = world * min(self.window_shards, len(remote)) * largest / 1e9
        if window_gb > self.read.cache_gb:
            raise InputError(
                f"data.cache_gb={self.read.cache_gb:g}: the windows of data.window_shards="
                f"{self.window_shards} shards of {world} processes take {window_gb:.3g} GB; set "
                f"data.cache_gb={window_gb * 1.01:.3g} or a smaller data.window_shards"
            )
        keys.windows_ahead = int(2 * window_gb <= self.read.cache_gb)
        return keys

    def training_batches(self) -> TrainingBatches:
        """Return training batches by `BatchKey`, flipped and augmented."""
        flip = 0.0 if self.flip == "both" else float(self.flip)
        return TrainingBatches(self.views, self.samples, self.augment, flip, self.seed)

    def choose_batch_device(self, device: torch.device, console: Console) -> torch.device | None:
        """Return the device that creates training batches, as `augment_on` says; None for the CPU.

        Args:
            device: device that trains.
            console: console for the names of transforms that only the CPU has.

        Raises:
            InputError: `augment_on=device` with a transform that only the CPU has.
        """
        if self.augment_on == "cpu" or (self.augment_on == "auto" and device.type == "cpu"):
            return None
        missing = ", ".join(self.augment.cpu_only)
        if missing and self.augment_on == "device":
            raise InputError(
                f"data.augment_on=device: {missing} has no equivalent on the device; leave it out "
                "of 'augment=[...]', or set data.augment_on=cpu"
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
        fed = copy.copy(self)
        fed._batch_device, fed.batches_per_step = batch_device, batches_per_step
        fed.features = features
        return fed

    def train_dataloader(self) -> DataLoader:
        """Return this rank's training batches."""
        keys: Any = self.sampler(*self._rank())
        if self.trainer is not None:  # a resumed run's first batch comes before Lightning's epoch
            keys.set_epoch(self.trainer.current_epoch)
            steps = self.trainer.fit_loop.epoch_loop.batch_progress.current.ready
            done = steps * self.batches_per_step
            keys.start = done if done < len(keys) else 0
            keys.fetch_ahead = self.views.fetch_ahead if self.views.shards else None
        training, workers = self.training_batches(), self.workers
        batches: Dataset = training
        if self.features is not None:
            batches = FeatureBatches(training, self.features)
        elif self._batch_device is not None:
            batches, workers = DeviceBatches(training, self._batch_device), 0
            self._device_batches = batches
        sampling: dict[str, Any] = {"batch_size": None, "sampler": keys}
        if self.batches_per_step > 1:
            sampling = {"batch_sampler": BatchSampler(keys, self.batches_per_step, drop_last=False)}
        return DataLoader(
            batches,
            collate_fn=unchanged,
            num_workers=workers,
            persistent_workers=workers > 0,
            **sampling,
        )

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

    def leaks(self) -> dict[str, Leak]:
        """Return the train/validation similarity of `val` and `test`; none of shards."""
        if self.views.shards:  # it would read most of them
            return {}

        @functools.cache  # both parts are compared with mostly the same training rows
        def thumbnail_of(row: int) -> np.ndarray:
            return thumbnail(self.views.take(np.array([row]), CENTER)[0])

        return {
            part: measure_leak(self.recording, self.split.train, rows, thumbnail_of)
            for part in PARTS[1:]
            if len(rows := getattr(self.split, part))
        }


def _are_weights(value: Any, count: int) -> bool:
    listed = isinstance(value, list | tuple) and len(value) == count
    return listed and all(type(one) in (int, float) and 0 < one <= 1000 for one in value)

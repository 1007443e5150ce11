"""Training batches whose images are selected, mirrored and augmented on the device that trains."""

from collections.abc import Iterator

import numpy as np
import psutil
import torch
from torch import Tensor
from torch.utils.data import Dataset

from datamodules.balance import BatchKey
from datamodules.batches import Batch, TrainingBatches, make_targets
from datamodules.row_views import RowViews

RESIDENT_SHARE = 0.5  # of the memory that is free when training begins
CHUNK = 4096  # images that are copied to the device at a time
TOGETHER = 2048  # images that are augmented at a time: 330 MB for each operation on PilotNet's


class DeviceBatches(Dataset):
    """The batches of `TrainingBatches`, drawn on the CPU and finished on the device.

    All views stay on the device if they fit; otherwise each batch's views are copied there.

    Args:
        batches: batches by key, which draw the random values.
        device: device that trains.
        room: most bytes that the views may take; None for half of the free memory.
    """

    def __init__(
        self, batches: TrainingBatches, device: torch.device, room: int | None = None
    ) -> None:
        self.batches, self.device = batches, device
        views = batches.views
        room = int(RESIDENT_SHARE * _free_bytes(device)) if room is None else room
        self.resident: Tensor | None = None
        if sum(file.nbytes for file in views.files) <= room:
            self.resident = _copied(views, device)
            self.starts = np.cumsum([0, *map(len, views.files)])[:-1]

    def __getitem__(self, key: BatchKey) -> Batch:
        """Return a drawn batch on the CPU, without images: see `finish`."""
        samples, shard = self.batches.samples, key.own
        views, (rows, cameras) = self.batches.views, samples.frames(shard)
        mirrored, steering, throttle, seed = self.batches.draw(key)
        share, shape = (key.share.start, len(key.samples)), views.files[0].shape[1:]
        drawn, steering = self.batches.augment.draw(shape, steering, seed, share)
        if self.resident is None:
            source = views.take(rows, cameras)
        else:
            source = self.starts[views.file[rows, cameras]] + views.position[rows, cameras]
        columns = {
            "source": source,  # images, or their numbers among those on the device
            # As whole numbers: Lightning would round the values to trainer.precision.
            "drawn": np.column_stack([mirrored, drawn]).astype(np.float32).view(np.int32),
            "speed": samples.speed_mph[shard].astype(np.float32),
            "targets": make_targets(steering, throttle),
        }
        return {name: torch.from_numpy(column) for name, column in columns.items()}

    def finish(self, group: list[Batch]) -> list[Batch]:
        """Return drawn batches with their images, all on the device.

        They are finished together, as many as `TOGETHER` images allow: a small batch costs a GPU
        less time than the program that starts its operations.
        """
        images = len(group[0]["targets"]) * self.batches.samples.windows.sequence
        count = max(1, TOGETHER // max(1, images))
        parts = [group[start : start + count] for start in range(0, len(group), count)]
        return [batch for part in parts for batch in self._finish(part)]

    def _finish(self, group: list[Batch]) -> Iterator[Batch]:
        columns = {name: self._copy(torch.cat([b[name] for b in group])) for name in group[0]}
        images, drawn = columns.pop("source"), columns.pop("drawn").view(torch.float32)
        if self.resident is not None:
            chosen = self.resident.index_select(0, images.ravel())
            images = chosen.reshape(*images.shape, *chosen.shape[1:])
        mirrored = drawn[:, 0].reshape(-1, *[1] * (images.ndim - 1)) > 0
        images = torch.where(mirrored, images.flip(-2), images)
        images = self.batches.augment.on_device(images, drawn[:, 1:])
        columns = {"images": images.movedim(-1, -3), **columns}
        sizes = [len(batch["targets"]) for batch in group]
        for tensors in zip(*(column.split(sizes) for column in columns.values()), strict=True):
            yield dict(zip(columns, tensors, strict=True))

    def _copy(self, tensor: Tensor) -> Tensor:
        if self.device.type == "cuda":  # so that the copy does not wait for the device
            tensor = tensor.pin_memory()
        return tensor.to(self.device, non_blocking=True)


def _copied(views: RowViews, device: torch.device) -> Tensor:
    """Copy all files of views to a device, as one tensor, uint8 [N, H, W, C]."""
    shape = (sum(map(len, views.files)), *views.files[0].shape[1:])
    copied, done = torch.empty(shape, dtype=torch.uint8, device=device), 0
    for file in views.files:
        for start in range(0, len(file), CHUNK):
            # torch needs writable memory, and a mapped file is read-only
            chunk = np.array(file[start : start + CHUNK])
            copied[done : done + len(chunk)].copy_(torch.from_numpy(chunk))
            done += len(chunk)
    return copied


def _free_bytes(device: torch.device) -> int:
    if device.type == "cuda":
        return torch.cuda.mem_get_info(device)[0]
    return psutil.virtual_memory().available

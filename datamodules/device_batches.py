"""Training batches that are created on the device that trains."""

import math

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


class DeviceBatches(Dataset):
    """The batches of `TrainingBatches`, selected, mirrored and augmented on the device.

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
        if sum(one.nbytes for one in views.files) <= room:
            self.resident = _copied(views, device)
            self.starts = np.cumsum([0, *map(len, views.files)])[:-1]

    def __getitem__(self, key: BatchKey) -> Batch:
        samples, own = self.batches.samples, key.own
        mirrored, steering, throttle, seed = self.batches.draw(key)
        images = self._images(*samples.frames(own))
        if mirrored.any():
            flips = self._copy(mirrored).reshape(-1, *[1] * (images.ndim - 1))
            images = torch.where(flips, images.flip(-2), images)
        place = (key.share.start, len(key.samples))
        images, steering = self.batches.augment.on_device(images, steering, seed, place)
        targets = make_targets(steering, throttle)
        flat = targets.reshape(len(own), math.prod(targets.shape[1:]))
        labels = self._copy(np.column_stack([flat, samples.speed_mph[own]]))
        return {
            "images": images.movedim(-1, -3),
            "speed": labels[:, -1],
            "targets": labels[:, :-1].unflatten(1, targets.shape[1:]),
        }

    def _images(self, rows: np.ndarray, cameras: np.ndarray) -> Tensor:
        """Return images on the device, uint8 [n, H, W, C], of windows [n, sequence, H, W, C]."""
        views = self.batches.views
        if self.resident is None:
            return self._copy(views.take(rows, cameras))
        at = self.starts[views.file[rows, cameras]] + views.position[rows, cameras]
        images = self.resident.index_select(0, self._copy(at.ravel()))
        return images.reshape(*at.shape, *images.shape[1:])

    def _copy(self, array: np.ndarray) -> Tensor:
        tensor = torch.from_numpy(array)
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

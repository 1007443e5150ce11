"""Batches as tensors, of training samples and of evaluated rows, alone and in groups.

Lightning's own work per step takes as long as two batches of a small network. With groups of 32
batches, several optimizer steps in one Lightning step, `experiment=tiny41` trains 2.1 times as many
samples per second as with groups of 1 (median of five interleaved rounds on two busy cores; 1.2 to
3.5).
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch.utils.data import Dataset

from datamodules.balance import BatchKey
from datamodules.recording import Recording
from datamodules.row_views import RowViews
from datamodules.samples import CENTER, LEFT, RIGHT, Samples
from datamodules.windows import SINGLE_FRAMES, Windows

if TYPE_CHECKING:
    from datamodules.augmented_batch import Augment  # slow import, which only a training needs

# images: uint8 [N, C, H, W], in memory as [N, H, W, C], the fastest layout for convolutions;
# speed: mph, float32 [N]; targets: steering and throttle, float32 [N, 2].
# With windows (see `datamodules.samples`), images: [N, sequence, C, H, W], oldest first; speed: of
# the newest frame; targets: [N, sequence + ahead, 2], for evaluation of the newest frame, [N, 2].
Batch = dict[str, torch.Tensor]

EVALUATION_BATCH = 256
GROUP = 32  # batches


@dataclass(frozen=True)
class TrainingBatches(Dataset):
    """Training batches by key; key and seed determine flips and augmentation."""

    views: RowViews
    samples: Samples
    augment: "Augment"
    flip: float
    seed: int

    def __getitem__(self, key: BatchKey) -> Batch:
        samples, shard = self.samples, key.own
        mirrored, steering, throttle, seed = self.draw(key)
        images = self.views.take(*samples.frames(shard), mirrored)
        self.augment.in_place(images, steering, seed, (key.share.start, len(key.samples)))
        return make_batch(images, steering, throttle, samples.speed_mph[shard])

    def steering(self, key: BatchKey) -> np.ndarray:
        """Return the newest frames' steering, float32 [n], flipped but not augmented."""
        steering = self.samples.steering[key.own]
        return np.where(self.draw(key)[0], -steering, steering)

    def draw(self, key: BatchKey) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
        """Return mirrored, bool [n], the steering and the throttle, and the augmentation's seed.

        They are drawn for the whole batch; `n` samples are this rank's. Steering and throttle are
        float32 [n], of windows [n, sequence + ahead].
        """
        rng = np.random.default_rng([self.seed, key.epoch, key.number])
        drawn = rng.random(len(key.samples)) < self.flip
        mirrored = self.samples.flipped[key.own] ^ drawn[key.share]
        steering, throttle = self.samples.labels(key.own)
        turned = mirrored.reshape(-1, *[1] * (steering.ndim - 1))
        return mirrored, np.where(turned, -steering, steering), throttle, int(rng.integers(2**31))


def unchanged(batch: Batch | list[Batch]) -> Batch | list[Batch]:
    """Return a batch as it is: a DataLoader's own function would search it for arrays."""
    return batch


@dataclass(frozen=True)
class EvaluationBatches(Dataset):
    """Batches of rows in order: one camera, recorded labels, no flips, no augmentation.

    All frames of the rows' windows must have an image.
    """

    views: RowViews
    recording: Recording
    rows: np.ndarray
    camera: int = CENTER
    least: int = 0  # least number of batches; without rows they are empty
    windows: Windows = SINGLE_FRAMES

    def share(self, rank: int, world: int) -> "EvaluationBatches":
        """Return one rank's contiguous rows.

        A rank without rows has one empty batch: without a batch the other ranks would wait for it.
        """
        return replace(self, rows=np.array_split(self.rows, world)[rank], least=1)

    def sides(self) -> tuple["EvaluationBatches", "EvaluationBatches"]:
        """Return the left and the right images of rows whose side images are all loaded."""
        loaded = self.views.file[self.windows.frames(self.rows)][..., [LEFT, RIGHT]] >= 0
        both = replace(self, rows=self.rows[loaded.all(axis=tuple(range(1, loaded.ndim)))])
        return replace(both, camera=LEFT), replace(both, camera=RIGHT)

    @property
    def size(self) -> int:
        """Return the rows of a batch: windows of more frames make smaller batches."""
        return max(1, EVALUATION_BATCH // self.windows.sequence)

    def __len__(self) -> int:
        return max(self.least, -(-len(self.rows) // self.size))

    def __getitem__(self, number: int) -> Batch:
        if number >= len(self):
            raise IndexError(number)
        rows = self.rows[number * self.size : (number + 1) * self.size]
        recording = self.recording
        return make_batch(
            self.views.take(self.windows.frames(rows), self.camera),
            recording.steering[rows],
            (recording.throttle - recording.brake)[rows],
            recording.speed_mph[rows],
        )


def make_batch(
    images: np.ndarray, steering: np.ndarray, throttle: np.ndarray, speed_mph: np.ndarray
) -> Batch:
    """Return arrays as a `Batch`; the images are uint8 [N, H, W, C] or [N, sequence, H, W, C]."""
    return {
        "images": torch.from_numpy(images).movedim(-1, -3),
        "speed": torch.from_numpy(speed_mph.astype(np.float32)),
        "targets": torch.from_numpy(make_targets(steering, throttle)),
    }


def make_targets(steering: np.ndarray, throttle: np.ndarray) -> np.ndarray:
    """Return targets, float32 [N, 2], of windows [N, sequence + ahead, 2], steering first."""
    return np.stack([steering, throttle], axis=-1).astype(np.float32)

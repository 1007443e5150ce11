"""Batches as tensors: of training samples, and of rows to evaluate on."""

from dataclasses import dataclass

import numpy as np
import torch
from torch.utils.data import Dataset

from datamodules.augment import Augment
from datamodules.balance import BatchKey
from datamodules.recording import Recording
from datamodules.row_views import RowViews
from datamodules.samples import CENTER, Samples

# uint8 [N, C, H, W], in memory as [N, H, W, C], which is what convolutions run fastest on; the
# speed in mph, float32 [N]; steering and throttle, float32 [N, 2].
Batch = dict[str, torch.Tensor]

EVALUATION_BATCH = 256


@dataclass(frozen=True)
class TrainingBatches(Dataset):
    """A batch by its key: pictures, flip and augmentation, all from the key's own seed."""

    views: RowViews
    samples: Samples
    augment: Augment
    flip: float
    seed: int

    def __getitem__(self, key: BatchKey) -> Batch:
        samples = self.samples
        pictures = self.views.take(samples.row[key.samples], samples.camera[key.samples])
        mirrored = self._mirrored(key)
        pictures[mirrored] = pictures[mirrored][:, :, ::-1]
        seed = int(self._rng(key, "augment").integers(2**31))
        pictures, steering = self.augment(pictures, self.steering(key), seed)
        return make_batch(
            pictures, steering, samples.throttle[key.samples], samples.speed_mph[key.samples]
        )

    def steering(self, key: BatchKey) -> np.ndarray:
        """The batch's steering, float32 [N], flipped but before any augmentation."""
        steering = self.samples.steering[key.samples]
        return np.where(self._mirrored(key), -steering, steering)

    def _mirrored(self, key: BatchKey) -> np.ndarray:
        draws = self._rng(key, "flip").random(len(key.samples))
        return self.samples.flipped[key.samples] ^ (draws < self.flip)

    def _rng(self, key: BatchKey, purpose: str) -> np.random.Generator:
        stream = ("flip", "augment").index(purpose)
        return np.random.default_rng([self.seed, key.epoch, key.number, stream])


@dataclass(frozen=True)
class EvaluationBatches(Dataset):
    """Rows in order, centre camera, true labels: never flipped, augmented, balanced or offset."""

    views: RowViews
    recording: Recording
    rows: np.ndarray

    def __len__(self) -> int:
        return -(-len(self.rows) // EVALUATION_BATCH)

    def __getitem__(self, number: int) -> Batch:
        if number >= len(self):
            raise IndexError(number)
        rows = self.rows[number * EVALUATION_BATCH : (number + 1) * EVALUATION_BATCH]
        recording = self.recording
        return make_batch(
            self.views.take(rows, CENTER),
            recording.steering[rows],
            (recording.throttle - recording.brake)[rows],
            recording.speed_mph[rows],
        )


def make_batch(
    pictures: np.ndarray, steering: np.ndarray, throttle: np.ndarray, speed_mph: np.ndarray
) -> Batch:
    """Arrays as the tensors of a `Batch`; the pictures uint8 [N, H, W, C]."""
    targets = np.stack([steering, throttle], axis=1).astype(np.float32)
    return {
        "images": torch.from_numpy(pictures).permute(0, 3, 1, 2),
        "speed": torch.from_numpy(speed_mph.astype(np.float32)),
        "targets": torch.from_numpy(targets),
    }

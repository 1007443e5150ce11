"""How near validation frames are to training frames: what a random split hides."""

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial.distance import cdist

from datamodules.recording import Recording

SAMPLED = 400  # rows of each kind that are compared: enough for a median
THUMBNAIL = (16, 8)


@dataclass(frozen=True)
class Leak:
    """Medians over validation (or test) rows.

    Attributes:
        seconds: to the nearest training row of the same recording; NaN where no time is known.
        likeness: the mean difference to the most alike training picture, as a share of the mean
            difference between any two pictures: near 0 is a copy, 1 a stranger.
    """

    seconds: float
    likeness: float


def measure_leak(
    recording: Recording,
    train: np.ndarray,
    held_out: np.ndarray,
    pictures: np.ndarray,
    seed: int = 0,
) -> Leak:
    """The leak from `train` rows to `held_out` rows (int64 row numbers), both non-empty.

    Args:
        pictures: uint8 [N, H, W, C], the centre views of all rows.
    """
    rng = np.random.default_rng(seed)
    rows = np.sort(rng.choice(held_out, min(SAMPLED, len(held_out)), replace=False))
    seconds = [
        np.abs(recording.time_s[same] - recording.time_s[row]).min()
        for row in rows
        if len(same := train[recording.recording[train] == recording.recording[row]])
    ]
    known = np.array(seconds)[np.isfinite(seconds)] if seconds else np.array([])
    # All neighbours of a sampled row must be among those compared, so few rows, but all training.
    compared = train if len(train) <= 20_000 else np.sort(rng.choice(train, 20_000, replace=False))
    ours, theirs = _thumbnails(pictures, rows), _thumbnails(pictures, compared)
    differences = cdist(ours, theirs, "cityblock") / ours.shape[1]
    stranger = np.median(differences)
    likeness = float(np.median(differences.min(axis=1)) / stranger) if stranger else 0.0
    return Leak(float(np.median(known)) if len(known) else float("nan"), likeness)


def _thumbnails(pictures: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """float32 [n, pixels] of small grey copies."""
    small = [cv2.resize(pictures[row], THUMBNAIL, interpolation=cv2.INTER_AREA) for row in rows]
    colours = np.stack(small).reshape(len(rows), THUMBNAIL[0] * THUMBNAIL[1], -1)
    return colours.mean(axis=2, dtype=np.float32)

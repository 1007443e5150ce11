"""Train/validation similarity: how close held-out frames are to training frames."""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from datamodules.recording import Recording
from datamodules.split import split_rows, split_words
from zoo.base.errors import InputError

SAMPLED = 400  # held-out rows that are compared: enough for a median
COMPARED = 20_000  # training rows that they are compared with, and also their neighbours
NEAR = 16  # neighbours on each side of a held-out row
AT_ONCE = 1_000  # rows whose differences stay in the processor's cache
STRANGERS = 4_000  # training rows for the difference between any two images
THUMBNAIL = (16, 8)
LEAST_ROWS = 600  # fewer are cut into blocks of less than two seconds
SEEDS = 10  # splits over which the error of a copied steering is a mean


@dataclass(frozen=True)
class Leak:
    """The train/validation similarity: medians over validation (or test) rows.

    Attributes:
        seconds: time to the nearest training row of the same recording; NaN without times.
        likeness: mean difference to the most similar training image, divided by the mean
            difference between any two images: near 0 for a copy, 1 for an unrelated image.
    """

    seconds: float
    likeness: float


def measure_leak(
    recording: Recording,
    train: np.ndarray,
    held_out: np.ndarray,
    thumbnail_of: Callable[[int], np.ndarray],
) -> Leak:
    """Return the similarity of held-out rows to training rows.

    Args:
        recording: recording of all rows.
        train: training row numbers, int64, not empty.
        held_out: held-out row numbers, int64, not empty.
        thumbnail_of: function from a row number to the `thumbnail` of its centre view.
    """
    rng = np.random.default_rng(0)
    rows = np.sort(rng.choice(held_out, min(SAMPLED, len(held_out)), replace=False))
    seconds = _seconds_to_nearest(recording, train, rows)
    finite = seconds[np.isfinite(seconds)]
    compared = train
    if len(train) > COMPARED:
        # A row's neighbours are its likely copies: they are compared in recordings of any length.
        around = np.searchsorted(train, rows)[:, None] + np.arange(-NEAR, NEAR)
        near = train[np.clip(around, 0, len(train) - 1)]
        compared = np.union1d(rng.choice(train, COMPARED, replace=False), near)
    nearest, stranger = _differences(_gray(thumbnail_of, rows), thumbnail_of, compared)
    likeness = float(np.median(nearest) / stranger) if stranger else 0.0
    return Leak(float(np.median(finite)) if len(finite) else float("nan"), likeness)


def random_split_leak(recording: Recording) -> tuple[float, float] | None:
    """Return the mean error of copying a neighbour's steering, of a random split and of blocks.

    Each validation row gets the steering of the training row that was recorded nearest to it, of
    the same recording, without a look at any image. The error is the mean over `SEEDS` splits.

    Returns:
        Mean absolute errors, of the random split and of the split into blocks of time; None of a
        recording that is too short to split, or whose steering never changes.
    """
    if len(recording) < LEAST_ROWS:
        return None
    errors = {}
    for kind in ("random", "blocks"):
        errors_of_kind = []
        for seed in range(SEEDS):
            try:
                split = split_rows(recording, kind, seed=seed)
            except InputError:
                return None
            after = np.searchsorted(split.train, split.val)
            sides = split.train[np.clip([after - 1, after], 0, len(split.train) - 1)]
            other = recording.recording[sides] != recording.recording[split.val]
            nearest = (np.abs(sides - split.val) + len(recording) * other).argmin(axis=0)
            copied = recording.steering[sides[nearest, np.arange(len(split.val))]]
            errors_of_kind.append(np.abs(copied - recording.steering[split.val]).mean())
        errors[kind] = float(np.mean(errors_of_kind))
    return (errors["random"], errors["blocks"]) if errors["blocks"] else None


def leak_lines(recording: Recording) -> list[str]:
    """Return a line on the share of the error that a random split hides, if it is known."""
    if (errors := random_split_leak(recording)) is None:
        return []
    hidden = max(0.0, 1 - errors[0] / errors[1])
    return [
        f"leak: a random split hides {hidden:.0%} of the error: without a look at an image, the "
        f"steering of the nearest training row errs by {errors[0]:.3f} on its validation rows, by "
        f"{errors[1]:.3f} on those of data.split=blocks, {split_words(recording, 'blocks')}"
    ]


def thumbnail(view: np.ndarray) -> np.ndarray:
    """Return a small copy of a view, uint8 [8, 16, C], or [8, 16] of a grey one."""
    return cv2.resize(view, THUMBNAIL, interpolation=cv2.INTER_AREA)


def _seconds_to_nearest(recording: Recording, train: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Return each row's seconds to its recording's nearest training row; NaN if unknown."""
    seconds = np.full(len(rows), np.nan)
    for number in np.unique(recording.recording[rows]):
        times = np.sort(recording.time_s[train[recording.recording[train] == number]])
        times = times[np.isfinite(times)]
        ours = recording.recording[rows] == number
        if not len(times):
            continue
        moments = recording.time_s[rows[ours]]
        after = np.searchsorted(times, moments)
        sides = times[np.clip([after - 1, after], 0, len(times) - 1)]
        seconds[ours] = np.abs(sides - moments).min(axis=0)
    return seconds


def _differences(
    ours: np.ndarray, thumbnail_of: Callable[[int], np.ndarray], compared: np.ndarray
) -> tuple[np.ndarray, float]:
    """Return each image's mean difference to the most similar compared one, float64 [n].

    Also return the median difference of any two. `ours` is float32 [n, pixels].
    """
    from scipy.spatial.distance import cdist  # slow import

    nearest, any_two = np.full(len(ours), np.inf), []
    step = -(-len(compared) // STRANGERS)
    for start in range(0, len(compared), AT_ONCE):
        theirs = _gray(thumbnail_of, compared[start : start + AT_ONCE])
        differences = cdist(ours, theirs, "cityblock") / ours.shape[1]
        np.minimum(nearest, differences.min(axis=1), out=nearest)
        any_two.append(differences[:, ::step].copy())
    return nearest, float(np.median(np.concatenate(any_two, axis=1)))


def _gray(thumbnail_of: Callable[[int], np.ndarray], rows: np.ndarray) -> np.ndarray:
    """Return the rows' thumbnails without colour, float32 [n, pixels]."""
    colours = np.stack([thumbnail_of(row) for row in rows])
    pixels = colours.reshape(len(rows), THUMBNAIL[0] * THUMBNAIL[1], -1)
    return pixels.mean(axis=2, dtype=np.float32)

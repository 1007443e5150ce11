"""How close held-out rows are to training rows, and what a random split hides."""

import numpy as np

from datamodules.recording import Recording
from datamodules.split import split_rows
from zoo.base.errors import InputError

LEAST_ROWS = 600  # fewer are cut into blocks of less than two seconds
SEEDS = 10  # splits over which the error of a copied steering is a mean


def seconds_apart(recording: Recording, train: np.ndarray, held_out: np.ndarray) -> float:
    """Return the median time from a held-out row to the nearest training row of its recording.

    Args:
        recording: recording of all rows.
        train: training row numbers, int64, not empty.
        held_out: held-out row numbers, int64, not empty.

    Returns:
        Seconds; NaN without times.
    """
    seconds = _seconds_to_nearest(recording, train, held_out)
    finite = seconds[np.isfinite(seconds)]
    return float(np.median(finite)) if len(finite) else float("nan")


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
        f"held-out rows: with data.split=random they lie beside training rows, and errors look "
        f"{hidden:.0%} smaller than on other stretches; judge by drives, or add data.split=blocks"
    ]


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

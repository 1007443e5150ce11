"""Stretches of a recording without a pause, and how far the steering returns to 0 in each."""

from dataclasses import dataclass

import numpy as np

from datamodules.recording import GAP_S, Recording
from datamodules.split import rows_per_second

STRETCH_S = 3.0
SLOWEST_MPH = 3.0
LEAST_CHANGE = 0.05  # change of steering, at least, in a recovery


@dataclass(frozen=True)
class Stretches:
    """Stretches of `length` rows.

    Attributes:
        first: first rows, int64 [n].
        after_pause: whether a stretch follows a pause, bool [n].
        length: number of rows in each.
    """

    first: np.ndarray
    after_pause: np.ndarray
    length: int


def find_stretches(recording: Recording) -> Stretches:
    """Return all stretches of `STRETCH_S` without a pause or standstill; each row may start one."""
    length = max(4, round(STRETCH_S * rows_per_second(recording)))
    broken = np.concatenate([[0], np.cumsum(find_breaks(recording))])
    first = np.arange(max(len(recording) - length + 1, 0))
    first = first[broken[first] == broken[first + length - 1]]
    slow = np.concatenate([[0], np.cumsum(recording.speed_mph < SLOWEST_MPH)])
    first = first[slow[first + length] == slow[first]]
    follows = np.concatenate([[False], _paused(recording) & ~_changes(recording)])
    return Stretches(first, follows[first], length)


def find_breaks(recording: Recording) -> np.ndarray:
    """Return whether a pause or a new recording begins after a row, bool [N - 1]."""
    return _paused(recording) | _changes(recording)


def _paused(recording: Recording) -> np.ndarray:
    steps = np.diff(recording.time_s)
    # Without times no pause can be found.
    return np.isfinite(steps) & ((steps > GAP_S) | (steps < 0))


def _changes(recording: Recording) -> np.ndarray:
    return np.diff(recording.recording) != 0


def steering_returns(recording: Recording, first: np.ndarray, length: int) -> np.ndarray:
    """Return how far each stretch's steering returns to 0, float64 [n].

    It is the largest |steering| in the first half, minus the mean of the last quarter.
    """
    steering = np.abs(recording.steering)[first[:, None] + np.arange(length)]
    return steering[:, : length // 2].max(1) - steering[:, -max(1, length // 4) :].mean(1)

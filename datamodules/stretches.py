"""Stretches and drives of a recording without a pause, and how steering returns in them."""

import itertools
from dataclasses import dataclass

import numpy as np

from datamodules.recording import GAP_S, Recording
from datamodules.split import rows_per_second

STRETCH_S = 3.0
SLOWEST_MPH = 3.0
LEAST_CHANGE = 0.05  # change of steering, at least, in a recovery
# Times of rows whose source has none: the log's names need a date.
FIRST_S = 946_684_800.0  # 2000-01-01
PAUSE_S = 10.0  # between two drives without times; longer than a gap
# A longer time to the next row, in usual steps of the recording, breaks a window. In a recording of
# the original simulator 2 of 2,699 steps are longer.
MOST_STEPS = 3
# Times with a usual step of at least so much are counted in so many parts of a second: a camera
# takes 0.2 to 200 frames in one.
PARTS = ((5e6, 1e9), (5e3, 1e6), (5.0, 1e3), (0.0, 1.0))


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


def missing_rows(recording: Recording) -> np.ndarray:
    """Return whether the next row is missing, by line or time, or a new recording's, bool [N-1]."""
    missing = _changes(recording)
    for number in range(len(recording.names)):
        rows = np.flatnonzero(recording.recording == number)
        for column, most in ((recording.line, 1), (recording.time_s, MOST_STEPS)):
            steps = np.diff(column[rows])
            forward = steps[steps > 0]  # not NaN, of a recording without times
            if len(forward):
                missing[rows[:-1]] |= steps > most * np.median(forward)
    return missing


def _paused(recording: Recording) -> np.ndarray:
    steps = np.diff(recording.time_s)
    # Without times no pause can be found.
    return np.isfinite(steps) & ((steps > GAP_S) | (steps < 0))


def _changes(recording: Recording) -> np.ndarray:
    return np.diff(recording.recording) != 0


def true_runs(mask: np.ndarray) -> tuple[tuple[int, int], ...]:
    """Return the runs of true values, bool [N]: the first, and the one after the last.

    >>> true_runs(np.array([True, True, False, True]))
    ((0, 2), (3, 4))
    """
    borders = np.flatnonzero(np.diff(mask.astype(np.int8), prepend=0, append=0)).tolist()
    return tuple(zip(borders[::2], borders[1::2], strict=True))


def steering_returns(recording: Recording, first: np.ndarray, length: int) -> np.ndarray:
    """Return how far each stretch's steering returns to 0, float64 [n].

    It is the largest |steering| in the first half, minus the mean of the last quarter.
    """
    steering = np.abs(recording.steering)[first[:, None] + np.arange(length)]
    return steering[:, : length // 2].max(1) - steering[:, -max(1, length // 4) :].mean(1)


def continuous_drives(recording: Recording, most: int | None = None) -> list[range]:
    """Return the rows between pauses and missing rows, in order.

    Args:
        recording: recording whose rows are numbered.
        most: largest number of rows in a drive; a longer one is cut.
    """
    ends = find_breaks(recording) | missing_rows(recording)
    borders, length = np.flatnonzero(ends) + 1, most or len(recording)
    return [
        range(start, min(start + length, stop))
        for first, stop in itertools.pairwise([0, *borders.tolist(), len(recording)])
        for start in range(first, stop, length)
    ]


def long_stretches(recording: Recording, rows: np.ndarray) -> list[np.ndarray]:
    """Return the stretches of `STRETCH_S` or more of neighbouring rows without a pause.

    Args:
        recording: recording of the rows.
        rows: numbers of rows, ascending, int64 [N].
    """
    ends = (np.diff(rows) != 1) | find_breaks(recording)[rows[:-1]]
    stretches = np.split(rows, np.flatnonzero(ends) + 1)
    least = STRETCH_S * mean_rate(recording)
    return [stretch for stretch in stretches if len(stretch) >= least]


def mean_rate(recording: Recording) -> float:
    """Return rows per second of `continuous_drives`; without times as `rows_per_second`.

    The median is wrong for steps of whole frames: 15 Hz in steps of 0.02 s has a median of 0.06 s.
    """
    steps = np.diff(recording.time_s)[~(find_breaks(recording) | missing_rows(recording))]
    steps = steps[steps >= 0]
    return float(1 / steps.mean()) if steps.any() else rows_per_second(recording)


def times_of_drives(drive: np.ndarray, since_start_s: np.ndarray) -> np.ndarray:
    """Return times for rows whose source has none: drives follow each other with pauses.

    Args:
        drive: number of each row's drive, int [N].
        since_start_s: seconds since the drive's first row, float64 [N].
    """
    times, start = np.empty(len(drive)), FIRST_S
    for part in np.split(np.arange(len(drive)), np.flatnonzero(np.diff(drive)) + 1):
        times[part] = start + since_start_s[part]
        start = times[part].max(initial=start) + PAUSE_S
    return times


def in_seconds(times: list[float], most: float = 1e9) -> list[float]:
    """Return times, NaN where unknown, in seconds; their usual step tells their unit.

    >>> in_seconds([50.0, 100.0, 150.0]), in_seconds([7.0, 7.05, 7.1]), in_seconds([50.0], 1e3)
    ([0.05, 0.1, 0.15], [7.0, 7.05, 7.1], [0.05])

    Args:
        times: times in any unit.
        most: parts of a second in which they may be counted, and are where no two times differ.
    """
    steps = np.diff(np.unique(np.array(times)[np.isfinite(times)]))
    fitting = (parts for least, parts in PARTS if len(steps) and np.median(steps) >= least)
    parts = min(next(fitting, most), most)
    return [time / parts for time in times]


def complete_times(recording: Recording) -> np.ndarray:
    """Return the times; where one is missing, at the usual rate, with a pause for missing rows."""
    if not np.isnan(recording.time_s).any():
        return recording.time_s
    drive = np.concatenate([[0], np.cumsum(find_breaks(recording) | missing_rows(recording))])
    return times_of_drives(drive, np.arange(len(recording)) / rows_per_second(recording))

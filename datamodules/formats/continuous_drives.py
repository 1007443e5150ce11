"""Continuous drives of a recording, which other formats call episodes or sessions."""

import numpy as np

from datamodules.recording import Recording
from datamodules.split import rows_per_second
from datamodules.stretches import find_breaks


def continuous_drives(recording: Recording, most: int | None = None) -> list[range]:
    """Return the rows between pauses, in order.

    Args:
        recording: recording whose rows are numbered.
        most: largest number of rows in a drive; a longer one is cut.
    """
    ends = [*(np.flatnonzero(find_breaks(recording)) + 1).tolist(), len(recording)]
    starts = [0, *ends[:-1]]
    length = most or len(recording)
    return [
        range(first, min(first + length, end))
        for start, end in zip(starts, ends, strict=True)
        for first in range(start, end, length)
    ]


def mean_rate(recording: Recording) -> float:
    """Return rows per second without pauses; without times as `rows_per_second`.

    The median is wrong for steps of whole frames: 15 Hz in steps of 0.02 s has a median of 0.06 s.
    """
    steps = np.diff(recording.time_s)[~find_breaks(recording)]
    steps = steps[steps > 0]
    return float(1 / steps.mean()) if len(steps) else rows_per_second(recording)

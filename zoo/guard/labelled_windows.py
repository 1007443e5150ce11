"""Windows of a drive: those that end some seconds before a failure, and nominal ones.

As in SelfOracle, Stocco et al. 2020, arXiv:1910.04443: a window lasts one second, and its score is
the mean of its frames' scores.
"""

from dataclasses import dataclass

import numpy as np

WINDOW_S = 1.0
LEADS_S = (1, 2, 3)  # seconds from a window's end to the failure
SETTLING_S = 1.0  # after a start or a put-back, in which no window begins


@dataclass(frozen=True)
class LabelledWindows:
    """Ranges of rows of a drive.

    Attributes:
        before: by lead in seconds, a range for each failure.
        normal: ranges that end more than the longest lead and one window before a failure; they
            do not overlap.
        failures: number of failures.
        late: by lead, number of failures without a range, because the car was put back or started
            too short a time before.
    """

    before: dict[int, list[slice]]
    normal: list[slice]
    failures: int
    late: dict[int, int]


def label_windows(time_s: np.ndarray, intervention: np.ndarray) -> LabelledWindows:
    """Return the windows of a drive.

    Args:
        time_s: time of each row in seconds, float [N].
        intervention: whether an intervention began in a row, bool [N]; the car is put back after.
    """
    before: dict[int, list[slice]] = {lead: [] for lead in LEADS_S}
    late = dict.fromkeys(LEADS_S, 0)
    normal: list[slice] = []
    failed = np.flatnonzero(intervention).tolist()
    begins = [0, *(row + 1 for row in failed)]
    for begin, end in zip(begins, [*failed, len(time_s)], strict=True):
        if begin >= len(time_s):
            continue
        settled_s = time_s[begin] + SETTLING_S
        rows_s = time_s[begin:end]
        last_s = np.inf if end == len(time_s) else time_s[end] - max(LEADS_S) - WINDOW_S
        if end < len(time_s):
            for lead in LEADS_S:
                first_s = time_s[end] - lead - WINDOW_S
                if first_s < settled_s - 1e-9:
                    late[lead] += 1
                else:
                    before[lead].append(_rows(rows_s, first_s, begin))
        latest_s = min(last_s, rows_s[-1]) if len(rows_s) else -np.inf
        count = int((latest_s - settled_s) / WINDOW_S + 1e-9) if latest_s > settled_s else 0
        normal += [_rows(rows_s, settled_s + number * WINDOW_S, begin) for number in range(count)]
    return LabelledWindows(before, normal, len(failed), late)


def window_scores(scores: np.ndarray, windows: list[slice]) -> np.ndarray:
    """Return the mean score of each window, float64 [windows]."""
    return np.array([scores[one].mean() for one in windows], float)


def _rows(rows_s: np.ndarray, first_s: float, begin: int) -> slice:
    """Return the rows after `first_s`, for the duration of a window."""
    first, last = np.searchsorted(rows_s, [first_s + 1e-6, first_s + WINDOW_S + 1e-6])
    return slice(begin + int(first), begin + int(last))

"""Windows of a drive, and figures of warnings: recall, precision, false-positive rate, F3, AUC.

As in SelfOracle, Stocco et al. 2020, arXiv:1910.04443: a window lasts one second, and its score is
the mean of its frames' scores. Windows end some seconds before a failure, or are nominal.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from zoo.drives.bootstrap import CONFIDENCE, Estimate
from zoo.drives.intervals import wilson_interval

FIGURES = ("recall", "precision", "false_positive_rate", "f3", "auc")
DRAWS = 2_000
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


def warning_figures(
    failing: Sequence[np.ndarray], normal: Sequence[np.ndarray], threshold: float, seed: int = 0
) -> dict[str, Estimate]:
    """Return the figures of alarms above a threshold, with 95 % intervals.

    The intervals resample whole drives with replacement, since windows of one drive resemble each
    other. Where no resample differs, the intervals of recall, precision and false-positive rate
    are Wilson's of the windows, and the others have no bounds.

    F3 weighs recall three times as much as precision: `10 P R / (9 P + R)`. AUC is the share of
    pairs of a failing and a normal window of which the failing one has the higher score.

    Args:
        failing: scores of the windows before a failure, float [n] of each drive.
        normal: scores of normal windows, float [n] of each drive.
        threshold: score above which a window raises an alarm.
        seed: random seed of the resamples.

    Returns:
        Estimates by name, see FIGURES; NaN where there is no window.

    >>> found = warning_figures([np.array([3.0, 1.0])], [np.array([0.0, 2.0, 0.5, 0.5])], 1.5)
    >>> [round(found[name].value, 3) for name in FIGURES]
    [0.5, 0.5, 0.25, 0.5, 0.875]
    """
    failing, normal = [[one for one in drives if len(one)] for drives in (failing, normal)]
    # By drive: windows with an alarm, and windows.
    (hits, all_failing), (false, all_normal) = (
        np.array([((one > threshold).sum(), len(one)) for one in drives], float).reshape(-1, 2).T
        for drives in (failing, normal)
    )
    # By pair of drives: pairs of windows of which the failing one has the higher score.
    above = [
        [(one[:, None] > other).sum() + (one[:, None] == other).sum() / 2 for other in normal]
        for one in failing
    ]
    pairs = np.array(above, float).reshape(len(failing), len(normal))

    def figures(failing_taken: np.ndarray, normal_taken: np.ndarray) -> dict[str, np.ndarray]:
        """Return the figures of resamples, by how often each takes each drive, [draws, drives]."""
        return _figures(
            failing_taken @ hits,
            failing_taken @ all_failing,
            normal_taken @ false,
            normal_taken @ all_normal,
            np.einsum("df,fn,dn->d", failing_taken, pairs, normal_taken),
        )

    sizes = len(failing), len(normal)
    values = figures(*(np.ones((1, size)) for size in sizes))
    rng = np.random.default_rng(seed)
    drawn = figures(*(_resamples(size, rng) for size in sizes))
    found = {name: _estimate(float(values[name][0]), drawn[name]) for name in FIGURES}
    for name, successes, trials in (
        ("recall", hits.sum(), all_failing.sum()),
        ("precision", hits.sum(), hits.sum() + false.sum()),
        ("false_positive_rate", false.sum(), all_normal.sum()),
    ):
        if trials and not np.isfinite(found[name].low):
            interval = wilson_interval(int(successes), int(trials))
            found[name] = Estimate(found[name].value, *interval)
    return found


def _resamples(size: int, rng: np.random.Generator) -> np.ndarray:
    """Return how often each resample takes each drive, int [DRAWS, size]."""
    if not size:
        return np.zeros((DRAWS, 0), int)
    return rng.multinomial(size, np.full(size, 1 / size), DRAWS)


def _figures(
    hits: np.ndarray, failing: np.ndarray, false: np.ndarray, normal: np.ndarray, above: np.ndarray
) -> dict[str, np.ndarray]:
    """Return the figures of counts: alarms among windows, and pairs in order; float [draws]."""
    with np.errstate(invalid="ignore", divide="ignore"):
        # Without any alarm there is no precision, but F3 is 0. Without a failure there is neither.
        exists = np.where(failing > 0, 1.0, np.nan)
        precision = exists * hits / (hits + false)
        f3 = exists * 10 * hits / (10 * hits + 9 * (failing - hits) + false)
        found = hits / failing, precision, false / normal, f3, above / (failing * normal)
    return dict(zip(FIGURES, found, strict=True))


def _estimate(value: float, drawn: np.ndarray) -> Estimate:
    drawn = drawn[np.isfinite(drawn)]
    if not np.isfinite(value) or not len(drawn):
        return Estimate(value)
    tail = (1 - CONFIDENCE) / 2
    low, high = np.quantile(drawn, [tail, 1 - tail])
    if low == high:
        return Estimate(value)
    return Estimate(value, float(low), float(high))

"""Confidence intervals of a share, for counts of few drives."""

import math
from collections.abc import Sequence

# A network does not vary and neither does a track: with other start seeds it fails in the same
# places (docs/scoring.md), so that an interval over them would count one observation several times.
ONE_TRACK = "Drives of one track fail in the same places: no interval."


def share_interval(successes: int, trials: int, confidence: float = 0.95) -> tuple[float, float]:
    """Return the exact interval of a share, from 0 to 1.

    It holds the true share at least as often as `confidence` says, however few the trials.
    Source: Clopper and Pearson 1934, "The use of confidence or fiducial limits illustrated in the
    case of the binomial".

    Args:
        successes: number of trials that succeeded.
        trials: number of trials; 0 gives (0.0, 1.0).
        confidence: share of such intervals that contain the true share, 0..1.

    >>> low, high = share_interval(3, 3)
    >>> round(low, 4), high
    (0.2924, 1.0)
    >>> [round(bound, 3) for bound in share_interval(2, 5)]
    [0.053, 0.853]
    >>> share_interval(0, 0)
    (0.0, 1.0)
    """
    from scipy.special import betaincinv  # slow import

    if not 0 <= successes <= trials:
        raise ValueError(f"{successes} of {trials}: must be from 0 to the number of trials")
    failures, beyond = trials - successes, (1 - confidence) / 2
    low = float(betaincinv(successes, failures + 1, beyond)) if successes else 0.0
    high = float(betaincinv(successes + 1, failures, 1 - beyond)) if failures else 1.0
    return low, high


def count_with_interval(successes: int, trials: int) -> str:
    """Return a count with the 95 % interval of its share.

    >>> count_with_interval(3, 3)
    '3 of 3 (95 %: 29 % or more)'
    >>> count_with_interval(0, 3)
    '0 of 3 (95 %: 71 % or less)'
    >>> count_with_interval(2, 5)
    '2 of 5 (95 %: 5 to 85 %)'
    >>> count_with_interval(0, 0)
    '0 of 0'
    """
    counted = f"{successes} of {trials}"
    if not trials:
        return counted
    low, high = (f"{100 * bound:.0f}" for bound in share_interval(successes, trials))
    if successes == trials:
        return f"{counted} (95 %: {low} % or more)"
    if successes == 0:
        return f"{counted} (95 %: {high} % or less)"
    return f"{counted} (95 %: {low} to {high} %)"


def median_interval(values: Sequence[float], confidence: float = 0.95) -> tuple[float, float]:
    """Return an interval of the median, from two of the values; NaN of fewer than 6 at 95 %.

    It holds for any distribution, because the number of values below the median is binomial.
    Source: Conover 1999, "Practical Nonparametric Statistics", section 3.2.

    Args:
        values: independent values, such as a figure of each start.
        confidence: smallest share of such intervals that contain the true median, 0..1.

    >>> median_interval([5, 1, 4, 2, 6, 3])
    (1, 6)
    >>> median_interval(range(12))
    (2, 9)
    """
    count, below, rank = len(values), 0.5 ** len(values), 0
    while below <= (1 - confidence) / 2:
        rank += 1
        below += math.comb(count, rank) * 0.5**count
    if not rank:
        return math.nan, math.nan
    ordered = sorted(values)
    return ordered[rank - 1], ordered[count - rank]

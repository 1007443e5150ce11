"""Figures with their 95 % intervals: of shares, medians, means and rates, from few drives.

Drives that share places and training seeds have `zoo.driving.clustered`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

# A network does not vary and neither does a track: with other start seeds it fails in the same
# places (docs/scoring.md), so that an interval over them would count one observation several times.
ONE_TRACK = "Drives of one track fail in the same places: no interval."
FEWEST_ROADS = 3  # of two, Student's t has one degree of freedom: an interval says nothing
MOST_VALUES = 4_000_000  # of an array; more are drawn in parts
TAIL = (1 - 0.95) / 2  # beyond each bound


@dataclass(frozen=True)
class Estimate:
    """A figure with the bounds of its 95 % interval; the bounds are NaN where none is known."""

    value: float
    low: float = math.nan
    high: float = math.nan


def bootstrap(
    values: np.ndarray,
    draws: int = 10_000,
    limits: tuple[float, float] = (-math.inf, math.inf),
) -> Estimate:
    """Estimate the mean of independent units, such as tracks or blocks of frames.

    The bounds are the percentiles of means of resampled units, moved away from the value by the
    factor of Student's t: percentiles alone are too narrow for few units.

    Values without any difference give an interval of width 0. It means that no difference was
    seen, not that there is none.

    Args:
        values: float array [units].
        draws: number of resamples.
        limits: smallest and greatest possible value, such as (0, 1) for a share.

    Returns:
        The estimate; NaN for a NaN or infinite value or no value, without bounds for fewer than
        three units.

    >>> bootstrap(np.array([0.5]))
    Estimate(value=0.5, low=nan, high=nan)
    """
    from scipy import special  # slow import

    if not values.size or not np.isfinite(values).all():
        return Estimate(math.nan)
    count, value = len(values), float(values.mean())
    if count < FEWEST_ROADS:
        return Estimate(value)
    rng = np.random.default_rng(0)
    parts = np.array_split(np.arange(draws), math.ceil(draws * count / MOST_VALUES))
    means = [values[rng.integers(count, size=(len(part), count))].mean(1) for part in parts]
    factor = float(special.stdtrit(count - 1, 1 - TAIL) / special.ndtri(1 - TAIL))
    factor *= math.sqrt(count / (count - 1))
    low, high = np.quantile(np.concatenate(means), [TAIL, 1 - TAIL])
    smallest, greatest = limits
    return Estimate(
        value,
        max(smallest, value + factor * (float(low) - value)),
        min(greatest, value + factor * (float(high) - value)),
    )


def mean_over_seeds(
    value: float,
    deviation: float | None,
    seeds: int,
    limits: tuple[float, float] = (-math.inf, math.inf),
) -> Estimate:
    """Return a mean over training seeds with its interval by Student's t.

    Args:
        value: the mean.
        deviation: sample standard deviation over the seeds; without one, or for 0, the estimate has
            no bounds.
        seeds: number of training seeds.
        limits: smallest and greatest possible value, such as (0, 1) for a share.

    >>> found = mean_over_seeds(0.95, 0.05, 3, (0, 1))
    >>> round(found.low, 3), found.high
    (0.826, 1)
    """
    from scipy import special  # slow import

    if not deviation or seeds < 2:
        return Estimate(value)
    half = float(special.stdtrit(seeds - 1, 1 - TAIL)) * deviation / math.sqrt(seeds)
    smallest, greatest = limits
    return Estimate(value, max(smallest, value - half), min(greatest, value + half))


def poisson_rate(count: int, exposure: float) -> Estimate:
    """Estimate the rate of events per unit from their count, with the exact interval.

    Source: Garwood 1936, "Fiducial limits for the Poisson distribution".

    Args:
        count: number of events, 0 or more.
        exposure: distance or time in which they were counted; the rate is NaN if it is not above 0.

    >>> round(poisson_rate(0, 2.0).high, 3)  # 3.69 events at most, in 2 units
    1.844
    """
    from scipy import special  # slow import

    if count < 0:
        raise ValueError(f"{count} events: must be 0 or more")
    if not exposure > 0:
        return Estimate(math.nan)
    low = float(special.gammaincinv(count, TAIL)) if count else 0.0
    high = float(special.gammaincinv(count + 1, 1 - TAIL))
    return Estimate(count / exposure, low / exposure, high / exposure)


def share_interval(successes: int, trials: int) -> tuple[float, float]:
    """Return the exact interval of a share, from 0 to 1.

    95 % of such intervals hold the true share, or more, however few the trials.
    Source: Clopper and Pearson 1934, "The use of confidence or fiducial limits illustrated in the
    case of the binomial".

    Args:
        successes: number of trials that succeeded.
        trials: number of trials; 0 gives (0.0, 1.0).

    >>> low, high = share_interval(3, 3)
    >>> round(low, 4), high
    (0.2924, 1.0)
    >>> [round(bound, 3) for bound in share_interval(2, 5)]
    [0.053, 0.853]
    >>> share_interval(0, 0)
    (0.0, 1.0)
    """
    from scipy import special  # slow import

    if not 0 <= successes <= trials:
        raise ValueError(f"{successes} of {trials}: must be from 0 to the number of trials")
    failures = trials - successes
    low = float(special.betaincinv(successes, failures + 1, TAIL)) if successes else 0.0
    high = float(special.betaincinv(successes + 1, failures, 1 - TAIL)) if failures else 1.0
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


def median_interval(values: Sequence[float]) -> tuple[float, float]:
    """Return an interval of the median, from two of the values; NaN of fewer than 6.

    It holds for any distribution, because the number of values below the median is binomial.
    Source: Conover 1999, "Practical Nonparametric Statistics", section 3.2.

    Args:
        values: independent values, such as a figure of each start.

    >>> median_interval([5, 1, 4, 2, 6, 3])
    (1, 6)
    >>> median_interval(range(12))
    (2, 9)
    """
    count, below, rank = len(values), 0.5 ** len(values), 0
    while below <= TAIL:
        rank += 1
        below += math.comb(count, rank) * 0.5**count
    if not rank:
        return math.nan, math.nan
    ordered = sorted(values)
    return ordered[rank - 1], ordered[count - rank]

"""Estimates of a mean, each with a 95 % interval: over units, over training seeds, and of a rate.

Drives that share places and training seeds have `zoo.driving.clustered`.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy import special

CONFIDENCE = 0.95
FEWEST_ROADS = 3  # of two, Student's t has one degree of freedom: an interval says nothing
MOST_VALUES = 4_000_000  # of an array; more are drawn in parts
TAIL = (1 - CONFIDENCE) / 2
_NORMAL = float(special.ndtri(1 - TAIL))


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
    if not values.size or not np.isfinite(values).all():
        return Estimate(math.nan)
    count, value = len(values), float(values.mean())
    if count < FEWEST_ROADS:
        return Estimate(value)
    rng = np.random.default_rng(0)
    parts = np.array_split(np.arange(draws), math.ceil(draws * count / MOST_VALUES))
    means = [values[rng.integers(count, size=(len(part), count))].mean(1) for part in parts]
    factor = float(special.stdtrit(count - 1, 1 - TAIL)) / _NORMAL
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
    if count < 0:
        raise ValueError(f"{count} events: must be 0 or more")
    if not exposure > 0:
        return Estimate(math.nan)
    low = float(special.gammaincinv(count, TAIL)) if count else 0.0
    high = float(special.gammaincinv(count + 1, 1 - TAIL))
    return Estimate(count / exposure, low / exposure, high / exposure)

"""Estimates over training seeds and roads, each with a 95 % interval."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import special

CONFIDENCE = 0.95
FEWEST_ROADS = 3  # of two, Student's t has one degree of freedom: an interval says nothing
MOST_VALUES = 4_000_000  # of an array; more are drawn in parts
_TAIL = (1 - CONFIDENCE) / 2
_NORMAL = float(special.ndtri(1 - _TAIL))


@dataclass(frozen=True)
class Estimate:
    """A figure with the bounds of its 95 % interval; the bounds are NaN where none is known."""

    value: float
    low: float = math.nan
    high: float = math.nan


Statistic = Callable[[np.ndarray], np.ndarray]


def interquartile_mean(values: np.ndarray) -> np.ndarray:
    """Return the mean of the middle half of the last axis.

    Equal to `scipy.stats.trim_mean(values, 0.25, axis=-1)`: a quarter of the values, rounded down,
    is left out at each end.

    Source: Agarwal et al. 2021, "Deep reinforcement learning at the edge of the statistical
    precipice", arXiv:2108.13264.

    >>> float(interquartile_mean(np.array([0.0, 1.0, 2.0, 90.0])))
    1.5
    """
    count = values.shape[-1]
    cut = count // 4
    middle: np.ndarray = np.sort(values, axis=-1)[..., cut : count - cut]
    return middle.mean(axis=-1) if count else np.full(values.shape[:-1], np.nan)


def mean(values: np.ndarray) -> np.ndarray:
    """Return the mean of the last axis; NaN if it is empty."""
    return values.mean(axis=-1) if values.shape[-1] else np.full(values.shape[:-1], np.nan)


def bootstrap(
    values: np.ndarray,
    statistic: Statistic,
    draws: int = 10_000,
    seed: int = 0,
    limits: tuple[float, float] = (-math.inf, math.inf),
) -> Estimate:
    """Estimate a statistic of the roads' means over the training seeds.

    Each draw resamples the training seeds and the roads, both with replacement. The bounds are the
    percentiles of the draws, moved away from the value by one factor. Without this factor, the
    interval of three seeds contains the truth in 74 % of the cases instead of 95 %, where seeds
    differ more than roads. The factor corrects the variance by n / (n - 1) for n seeds or roads,
    and uses Student's t with Satterthwaite's degrees of freedom instead of the normal distribution.
    Where single drives vary more than seeds and roads, the interval is too wide: it contains the
    truth in up to 99 % of the cases.

    Values without any difference give an interval of width 0. It means that no difference was
    seen, not that there is none; for counts, use `poisson_rate` or `wilson_interval`.

    Sources: Owen 2007, "The pigeonhole bootstrap"; Satterthwaite 1946, "An approximate distribution
    of estimates of variance components".

    Args:
        values: float array [seeds, roads]; or [seeds of A, seeds of B, roads], where each axis of
            seeds is resampled by itself. An axis of length 1 is not resampled: a single training
            seed gives an interval over roads alone.
        statistic: function that reduces the last axis of an array [..., roads], such as
            `interquartile_mean` and `mean`; `np.mean` reduces all axes and is refused.
        draws: number of resamples.
        seed: random seed of the resamples.
        limits: smallest and greatest possible value, such as (0, 1) for a share.

    Returns:
        The estimate; NaN for a NaN or infinite value or no value, without bounds for fewer than
        three roads.

    >>> bootstrap(np.array([[0.5]]), mean)
    Estimate(value=0.5, low=nan, high=nan)
    """
    if not values.size or not np.isfinite(values).all():
        return Estimate(math.nan)
    roads = values.shape[-1]
    each_axis = range(values.ndim - 1)
    per_road = values.mean(axis=tuple(each_axis))
    value = float(statistic(per_road))
    if roads < FEWEST_ROADS:
        return Estimate(value)
    rng = np.random.default_rng(seed)
    # How often each draw takes each training seed, as a share: [draws, seeds].
    shares = [rng.multinomial(n, np.full(n, 1 / n), draws) / n for n in values.shape[:-1]]
    seeds_alone = [
        shares[axis] @ values.mean(axis=tuple(other for other in each_axis if other != axis))
        for axis in each_axis
    ]
    of_roads, of_both = [], []
    for part in np.array_split(np.arange(draws), math.ceil(draws * values[0].size / MOST_VALUES)):
        drawn = rng.integers(roads, size=(len(part), roads))
        of_roads.append(_reduced(statistic, per_road[drawn]))
        means = _seed_means(values, [share[part] for share in shares])
        of_both.append(_reduced(statistic, np.take_along_axis(means, drawn, axis=-1)))
    alone = [
        *(_reduced(statistic, estimates) for estimates in seeds_alone),
        np.concatenate(of_roads),
    ]
    factor = _widening([float(estimates.var()) for estimates in alone], values.shape)
    low, high = np.quantile(np.concatenate(of_both), [_TAIL, 1 - _TAIL])
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
    half = float(special.stdtrit(seeds - 1, 1 - _TAIL)) * deviation / math.sqrt(seeds)
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
    low = float(special.gammaincinv(count, _TAIL)) if count else 0.0
    high = float(special.gammaincinv(count + 1, 1 - _TAIL))
    return Estimate(count / exposure, low / exposure, high / exposure)


def _seed_means(values: np.ndarray, shares: list[np.ndarray]) -> np.ndarray:
    """Return each draw's means over its training seeds: [draws, roads]."""
    first, *others = shares
    means: np.ndarray = np.tensordot(first, values, axes=1)
    for share in others:
        means = np.einsum("ds,ds...->d...", share, means)
    return means


def _reduced(statistic: Statistic, values: np.ndarray) -> np.ndarray:
    reduced = statistic(values)
    if np.shape(reduced) != values.shape[:-1]:
        raise ValueError(f"{statistic}: must reduce the last axis alone, such as bootstrap.mean")
    return reduced


def _widening(variances: list[float], counts: tuple[int, ...]) -> float:
    """Return the factor of an interval's width.

    Args:
        variances: variance of the draws that resample one axis alone, for each axis.
        counts: length of each axis.
    """
    resampled = [(variance, n) for variance, n in zip(variances, counts, strict=True) if n > 1]
    total = sum(variance for variance, _ in resampled)
    if not total:
        return 1.0
    unbiased = [(variance * n / (n - 1), n - 1) for variance, n in resampled]
    sum_unbiased = sum(variance for variance, _ in unbiased)
    freedom = sum_unbiased**2 / sum(variance**2 / degrees for variance, degrees in unbiased)
    return math.sqrt(sum_unbiased / total) * float(special.stdtrit(freedom, 1 - _TAIL)) / _NORMAL

"""Estimates with 95 % intervals: bootstrap over roads and training seeds, and exact rates."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import stats


@dataclass(frozen=True)
class Estimate:
    """A figure with its 95 % interval; NaN bounds where there is none."""

    value: float
    low: float
    high: float


def interquartile_mean(values: np.ndarray) -> float:
    """Return the mean of the middle half."""
    return float(stats.trim_mean(values, 0.25, axis=None))


def bootstrap(
    values: np.ndarray,
    statistic: Callable[[np.ndarray], float],
    draws: int = 10_000,
    seed: int = 0,
) -> Estimate:
    """Return a statistic of [seeds, roads] with an interval over both."""
    rng = np.random.default_rng(seed)
    seeds, roads = values.shape
    found = [
        statistic(values[rng.integers(seeds, size=seeds)][:, rng.integers(roads, size=roads)])
        for _ in range(min(draws, 500))
    ]
    return Estimate(statistic(values), *np.quantile(found, [0.025, 0.975]).tolist())


def poisson_rate(count: int, exposure: float) -> Estimate:
    """Return events per unit of exposure with the exact interval (Garwood 1936)."""
    low = stats.chi2.ppf(0.025, 2 * count) / 2 if count else 0.0
    high = stats.chi2.ppf(0.975, 2 * count + 2) / 2
    return Estimate(count / exposure, float(low / exposure), float(high / exposure))

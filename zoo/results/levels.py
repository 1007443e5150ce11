"""The level of an axis at which the share of clean drives falls to a given share."""

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from scipy import special

from zoo.driving.clustered import EQUAL, satterthwaite
from zoo.driving.intervals import FEWEST_ROADS, TAIL, Estimate

STEPS = 50  # of Newton's method, which needs about 8


def level_at(
    share: float, clean: np.ndarray, levels: Sequence[int], places: Sequence[str]
) -> Estimate:
    """Estimate the level at which a share of the drives is clean, by a logistic curve.

    The curve is fitted with Firth's penalty (1993), which is finite where all drives below a level
    are clean and all above are not. The interval is that of the jackknife over places and over
    training seeds, whose variances add up, with Student's t.

    Args:
        share: share of clean drives, 0..1.
        clean: whether each drive was clean, float array [training seeds, drives].
        levels: level of each drive, from 1 on.
        places: place of each drive; drives of one place are one cluster.

    Returns:
        The level, from half a level below the first to half a level above the last one: at these
        ends the true level may be beyond.

    >>> levels = [1, 2, 3, 4] * 8
    >>> found = level_at(0.5, np.array([[1.0, 1, 0, 0] * 8]), levels, np.repeat(range(8), 4))
    >>> round(found.value, 2)
    2.5
    """
    weights = np.ones_like(clean)
    value = _level(share, clean, weights, levels)
    names, numbers = np.unique(np.asarray(places), return_inverse=True)
    left_out = [
        [numbers == number for number in range(len(names))],
        [(np.arange(len(clean)) == seed)[:, None] for seed in range(len(clean))],
    ]
    parts = []
    for clusters in left_out:
        if (count := len(clusters)) < 2:
            continue
        without = [
            _level(share, clean, np.where(cluster, 0.0, weights), levels) for cluster in clusters
        ]
        variance = (count - 1) * float(np.var(without))
        if variance > EQUAL**2:
            parts.append((variance, count - 1.0))
    if len(names) < FEWEST_ROADS or not parts:
        return Estimate(value)
    half = float(special.stdtrit(satterthwaite(parts), 1 - TAIL))
    half *= math.sqrt(sum(variance for variance, _ in parts))
    first, last = min(levels), max(levels)
    # Beyond the levels the curve is not seen: the bound is the end.
    low = value - half if value >= first else -math.inf
    high = value + half if value <= last else math.inf
    return Estimate(value, max(low, first - 0.5), min(high, last + 0.5))


def _level(share: float, clean: np.ndarray, weights: np.ndarray, levels: Sequence[int]) -> float:
    """Return the level of a share on the curve of weighted drives."""
    steps = np.unique(np.asarray(levels))
    columns = np.asarray(levels)[None] == steps[:, None]
    drives = tuple(weights[:, column].sum() for column in columns)
    kept = tuple((clean * weights)[:, column].sum() for column in columns)
    middle, slope = _curve(tuple(steps), drives, kept)
    above = middle - special.logit(share)  # of the log odds, at the middle level
    level = steps.mean() - above / slope if slope < -EQUAL else math.copysign(math.inf, above)
    return float(np.clip(level, steps[0] - 0.5, steps[-1] + 0.5))


@lru_cache(1000)  # most places of a jackknife have the sums of another
def _curve(
    levels: tuple[int, ...], drives: tuple[float, ...], kept: tuple[float, ...]
) -> tuple[float, float]:
    """Return the log odds of a clean drive at the middle level, and their slope.

    Args:
        levels: the levels, in order.
        drives: number of drives of each.
        kept: number of clean ones.
    """
    steps, count, clean = map(np.array, (levels, drives, kept))
    design = np.stack([np.ones(len(steps)), steps - steps.mean()], 1)
    curve = np.zeros(2)
    for _ in range(STEPS):
        chance = special.expit(design @ curve)
        spread = count * chance * (1 - chance)
        inverse = np.linalg.pinv(design.T @ (spread[:, None] * design))
        leverage = np.einsum("ij,jk,ik->i", design, inverse, design) * spread
        score = design.T @ (clean - count * chance + leverage * (0.5 - chance))
        step = inverse @ score
        curve += step * min(1.0, 2 / max(np.abs(step).max(), 1e-12))
        if np.abs(step).max() < 1e-8:
            break
    return float(curve[0]), float(curve[1])

"""Estimates over drives that share places and training seeds, each with a 95 % interval.

Drives are neither many nor independent: most have no intervention, two drives of one road fail at
the same bend, and all drives of one training share its faults. The estimates hold for new places
like those driven and, with two training seeds or more, for new trainings.

Intervals: Taylor linearisation of a ratio of sums, with the variance between places within a
stratum plus that between the seeds of each entry (Owen 2007, "The pigeonhole bootstrap", in closed
form), Student's t with Satterthwaite's degrees of freedom (1946), on the scale of the logarithm
or, for a share, of the log odds. The bounds include those of no failure at any place (Clopper and
Pearson 1934), so that a network that never failed is not surer than one that failed once.
docs/benchmark.md shows how often the intervals contain the truth.
"""

import math
from collections import Counter
from collections.abc import Sequence

import numpy as np
from scipy import special

from zoo.driving.intervals import FEWEST_ROADS, TAIL, Estimate

ANY, POSITIVE, SHARE = (-math.inf, math.inf), (0.0, math.inf), (0.0, 1.0)  # limits of a figure


def clustered(
    values: np.ndarray,
    weights: np.ndarray | None = None,
    *,
    places: Sequence[str],
    groups: Sequence[str] | None = None,
    limits: tuple[float, float] = ANY,
    one_failure: float | None = None,
) -> Estimate:
    """Estimate a sum of values divided by a sum of weights, such as interventions per km.

    Args:
        values: float array [training seeds, drives]; [seeds of A, seeds of B, drives] for a
            comparison of two entries. A single training seed gives an interval over places alone.
        weights: array of the same shape; None for 1, so that the figure is a mean.
        places: place of each drive; drives of one place are one cluster.
        groups: group of each drive. Places that are driven in the same groups are a stratum, if
            every stratum has five places or more; None for one stratum.
        limits: `POSITIVE`, `SHARE`, `ANY`, or the smallest and the greatest difference.
        one_failure: figure if each drive had one failure, for a figure that is 0 without any
            failure; it is the scale of the exact bound.

    Returns:
        The estimate; NaN for no or infinite values, without bounds for fewer than three places.

    >>> found = clustered(np.zeros((3, 30)), places=range(30), limits=SHARE, one_failure=1.0)
    >>> found.low, round(found.high, 3)
    (0.0, 0.116)
    """
    value, variance, freedom = moments(values, weights, places=places, groups=groups)
    count = len(set(places))
    if math.isnan(value) or count < FEWEST_ROADS:
        return Estimate(value)
    smallest, greatest = limits
    half = float(special.stdtrit(freedom, 1 - TAIL)) * math.sqrt(variance) if variance else 0.0
    low = high = value
    if half and smallest == 0 < value < greatest:
        room = 1 - value / greatest  # of the log odds; 1 for the logarithm
        odds, factor = value / room, math.exp(min(half / (value * room), 700.0))
        low, high = (limit / (1 + limit / greatest) for limit in (odds / factor, odds * factor))
    elif half:
        low, high = max(smallest, value - half), min(greatest, value + half)
    unseen = no_failure(count)  # greatest share of places that none seen is like
    if one_failure is not None:
        low = min(low, max(0.0, greatest - unseen * one_failure))
        high = min(greatest, max(high, unseen * one_failure))
    elif not half:  # all places are equal
        if not all(map(math.isfinite, limits)):
            return Estimate(value)
        low, high = (value + unseen * (limit - value) for limit in limits)
    return Estimate(value, low, high)


def moments(
    values: np.ndarray,
    weights: np.ndarray | None = None,
    *,
    places: Sequence[str],
    groups: Sequence[str] | None = None,
) -> tuple[float, float, float]:
    """Return a ratio of sums, its variance, and the variance's degrees of freedom.

    See `clustered` for the arguments. Without a variance the degrees of freedom are 1.
    """
    weights = np.ones_like(values) if weights is None else weights
    total = float(weights.sum())
    if not values.size or not np.isfinite(values).all() or not total > 0:
        return math.nan, math.nan, math.nan
    value = float(values.sum()) / total
    parts = (values - value * weights) / total
    axes = range(parts.ndim)
    sums = [parts.sum(axis=tuple(other for other in axes if other != axis)) for axis in axes]
    *by_seed, by_drive = sums
    variances = [_variance(seed_sums) for seed_sums in by_seed]
    variances += [
        _variance(np.bincount(_numbers(roads), by_drive[chosen]))
        for chosen, roads in _strata(places, groups)
    ]
    usable = [(variance, freedom) for variance, freedom in variances if variance > EQUAL**2]
    return value, sum(part for part, _ in usable), satterthwaite(usable) if usable else 1.0


EQUAL = 1e-9  # greatest difference of equal figures, by rounding
SMALLEST = 5  # places of a stratum; with few degrees of freedom Student's t says nothing


def satterthwaite(parts: Sequence[tuple[float, float]]) -> float:
    """Return the degrees of freedom of a sum of variances, each with its own."""
    total = sum(variance for variance, _ in parts)
    return total**2 / sum(variance**2 / freedom for variance, freedom in parts)


def no_failure(trials: int) -> float:
    """Return the greatest share that fails where none of some trials did.

    The upper bound of the exact 95 % interval of 0 of n (Clopper and Pearson 1934).

    >>> round(no_failure(30), 3), round(no_failure(3), 3)
    (0.116, 0.708)
    """
    return 1 - float(TAIL ** (1 / trials))


def p_value(difference: np.ndarray, places: Sequence[str], groups: Sequence[str]) -> float:
    """Return the two-sided p-value of a mean difference of shares, 0..1; see `clustered`."""
    value, variance, freedom = moments(difference, places=places, groups=groups)
    if variance:
        return 2 * float(special.stdtr(freedom, -abs(value) / math.sqrt(variance)))
    return min(1.0, 2 * (1 / (1 + abs(value))) ** len(set(places)))  # where the exact bound is 0


def holm(p_values: Sequence[float]) -> list[float]:
    """Return p-values corrected for their number, in the same order.

    Source: Holm 1979, "A simple sequentially rejective multiple test procedure".

    >>> holm([0.01, 0.04, 0.03])
    [0.03, 0.06, 0.06]
    """
    corrected, greatest = [0.0] * len(p_values), 0.0
    for done, index in enumerate(np.argsort(p_values, kind="stable")):
        greatest = max(greatest, min(1.0, (len(p_values) - done) * p_values[index]))
        corrected[index] = greatest
    return corrected


def _variance(sums: np.ndarray) -> tuple[float, float]:
    """Return the variance of a sum over clusters, and its degrees of freedom."""
    count = len(sums)
    if count < 2:
        return 0.0, 1.0
    return count * float(sums.var(ddof=1)), count - 1.0


def _strata(
    places: Sequence[str], groups: Sequence[str] | None
) -> list[tuple[list[int], list[str]]]:
    """Return the drives of each stratum and their places."""
    driven: dict[str, set[str]] = {}
    for place, group in zip(places, groups or [""] * len(places), strict=True):
        driven.setdefault(place, set()).add(group)
    kinds = {place: repr(sorted(kinds_of_place)) for place, kinds_of_place in driven.items()}
    is_fine = min(Counter(kinds.values()).values()) >= SMALLEST
    drives: dict[str, list[int]] = {}
    for number, place in enumerate(places):
        drives.setdefault(kinds[place] if is_fine else "", []).append(number)
    return [(drive, [places[number] for number in drive]) for drive in drives.values()]


def _numbers(places: Sequence[str]) -> list[int]:
    order = {place: number for number, place in enumerate(dict.fromkeys(places))}
    return [order[place] for place in places]

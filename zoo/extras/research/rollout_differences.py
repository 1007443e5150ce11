"""Differences between policies over rollouts, with the statistics of `zoo.driving.clustered`.

A policy's mean is a ratio of sums. What each rollout adds to it (Taylor linearisation) is a table
of trainings and units, so that rollouts that are paired and those that are not take one function.
"""

import math
from bisect import bisect_left
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from statistics import harmonic_mean

import numpy as np

from zoo.driving.clustered import ANY, EQUAL, SHARE, SMALLEST, clustered, holm, moments, p_value
from zoo.driving.intervals import FEWEST_ROADS, Estimate
from zoo.extras.research.rollouts import Rollout
from zoo.results.differences import SIGNIFICANT, least_difference

THESE, NEW = "these scenes", "new scenes"
SCOPES = (THESE, NEW)
UNDECIDED, UNKNOWN = "not told apart", "unknown"
MOST_TIMES = 100  # as many rollouts, scenes or trainings as there are
Parts = list[tuple[float, float]]  # variances with their degrees of freedom
Units = list[tuple[str, ...]]


@dataclass(frozen=True)
class Difference:
    """The mean score of policy A minus that of policy B.

    Attributes:
        a: name of policy A.
        b: name of policy B.
        scope: THESE, for new rollouts in the same scenes; NEW, for other scenes like them.
        figure: difference with its 95 % interval; no bounds for fewer than three units.
        p: p-value, corrected for the number of pairs (Holm); 1 without bounds.
        needed: `rollouts` in each scene, `scenes` or `trainings` that would tell them apart with a
            probability of 80 %, as the only pair; None where more of these alone do not.
    """

    a: str
    b: str
    scope: str
    figure: Estimate
    p: float
    needed: dict[str, int | None]

    @property
    def verdict(self) -> str:
        """Return which policy is better, or that it is not told or unknown."""
        if math.isnan(self.figure.low):
            return UNKNOWN
        if self.p >= SIGNIFICANT:
            return UNDECIDED
        return f"{self.a if self.figure.value > 0 else self.b} is better"


def limits_of(policies: Iterable[Sequence[Rollout]]) -> tuple[float, float]:
    """Return `SHARE` if the scores of all policies are in 0..1, else `ANY`."""
    return SHARE if all(0 <= row.score <= 1 for rows in policies for row in rows) else ANY


def is_thin(*policies: Sequence[Rollout]) -> bool:
    """Return whether three or more scenes have too few rollouts for a variance in each.

    That between scenes then stands for it, which is never smaller in the long run.
    """
    counts = [
        Counter(unit[0] for unit in set(_units(rollouts, THESE))).values() for rollouts in policies
    ]
    return any(min(count) < SMALLEST for count in counts) and len(counts[0]) >= FEWEST_ROADS


def mean_score(rollouts: Sequence[Rollout], scope: str, limits: tuple[float, float]) -> Estimate:
    """Return a policy's mean score with its 95 % interval over rollouts or scenes.

    Args:
        rollouts: rollouts of the policy.
        scope: THESE or NEW.
        limits: limits of the score, those of all compared policies; see `limits_of`.
    """
    scope = NEW if is_thin(rollouts) else scope
    units = _units(rollouts, scope)
    order = list(dict.fromkeys(units))
    sums, counts = _tables(rollouts, units, order)
    return clustered(
        sums,
        counts,
        places=list(map(repr, order)),
        groups=_strata([units], order, scope),
        limits=limits,  # `one_failure` would widen all intervals: 98.2 % at 79 % success
    )


def compare_policies(policies: dict[str, list[Rollout]], paired: bool = False) -> list[Difference]:
    """Return the difference of each pair of policies, on these scenes and on new ones.

    Args:
        policies: rollouts by the name of the policy.
        paired: whether trainings of the same seed are pairs.
    """
    rows: list[Difference] = []
    limits = (-1.0, 1.0) if limits_of(policies.values()) == SHARE else ANY
    for scope in SCOPES:
        of_scope = [
            _difference(policies[a], policies[b], scope, paired, limits)
            for a, b in combinations(policies, 2)
        ]
        rows += [
            replace(row, p=p, needed=row.needed if p >= SIGNIFICANT else {})
            for row, p in zip(of_scope, holm([row.p for row in of_scope]), strict=True)
        ]
    return rows


def _difference(
    a: list[Rollout], b: list[Rollout], scope: str, paired: bool, limits: tuple[float, float]
) -> Difference:
    named, scope = scope, NEW if is_thin(a, b) else scope
    values, order, groups = _linear_parts(a, b, scope, paired)
    names = list(map(repr, order))
    figure = clustered(values, places=names, groups=groups, limits=limits)
    p = p_value(values, names, groups) if len(order) >= FEWEST_ROADS else 1.0
    needed = {}
    if scope == named and len(order) >= FEWEST_ROADS and abs(figure.value) > EQUAL:
        needed = _needed(a, b, scope, paired)
    return Difference(a[0].policy, b[0].policy, named, figure, p, needed)


def _units(rollouts: Sequence[Rollout], scope: str) -> Units:
    """Return the unit of each rollout: its scene, or its scene and seed.

    A rollout without a seed is a unit that no other policy or training has.
    """
    if scope == NEW:
        return [(row.scene,) for row in rollouts]
    units: Units = []
    for number, row in enumerate(rollouts):
        alone = (row.policy, str(number)) if not row.seed else ()
        units.append((row.scene, row.seed, *alone))
    return units


def _strata(units: Sequence[Units], order: Units, scope: str) -> list[str]:
    """Return the stratum of each unit: of these scenes, a scene and the policies that have it."""
    if scope == NEW:
        return [""] * len(order)
    sets = list(map(set, units))
    return [repr((unit[0], [unit in policy for policy in sets])) for unit in order]


def _tables(rollouts: Sequence[Rollout], units: Units, order: Units) -> list[np.ndarray]:
    """Return the sums of scores and those of weights, float64 [trainings, units]."""
    columns = {unit: number for number, unit in enumerate(order)}
    trainings = sorted({row.training for row in rollouts})
    sums, counts = np.zeros((2, len(trainings), len(order)))
    for row, unit in zip(rollouts, units, strict=True):
        cell = trainings.index(row.training), columns[unit]
        sums[cell] += row.score * row.weight
        counts[cell] += row.weight
    return [sums, counts]


def _linear_parts(
    a: list[Rollout], b: list[Rollout], scope: str, paired: bool
) -> tuple[np.ndarray, Units, list[str]]:
    """Return values whose mean is the difference, [trainings of A, of B, units]; units; strata.

    Of paired trainings, the values are [trainings, units].
    """
    both = [_units(rollouts, scope) for rollouts in (a, b)]
    order = list(dict.fromkeys([*both[0], *both[1]]))
    means, added = [], []
    for rollouts, units in zip((a, b), both, strict=True):
        sums, counts = _tables(rollouts, units, order)
        means.append(sums.sum() / counts.sum())
        added.append((sums - means[-1] * counts) / counts.sum())
    of_a, of_b = added
    if not paired:
        of_a, of_b = of_a[:, None] / len(of_b), of_b[None] / len(of_a)
    parts = of_a - of_b
    return means[0] - means[1] + parts.size * parts, order, _strata(both, order, scope)


def _needed(a: list[Rollout], b: list[Rollout], scope: str, paired: bool) -> dict[str, int | None]:
    """Return the rollouts in a scene, the scenes and the trainings that would decide, each alone.

    It takes the seen difference and variances for the true ones, as `seeds_needed` does.
    """
    values, units, variance, freedom = _unit_variance(a, b, scope, paired)
    difference = abs(float(values.mean()))
    trained: Parts = []
    for axis, count in enumerate(values.shape[:-1]):
        means = np.moveaxis(values, axis, 0).reshape(count, -1).mean(axis=1)
        trained.append((moments(means, places=list(map(str, range(count))))[1], count))
    now: Parts = [(variance, count - 1) for variance, count in trained]
    scenes = len({unit[0] for unit in units})
    # As many of each policy have the variance of those that there are.
    each = harmonic_mean([len(a) / values.shape[0], len(b) / values.shape[-2]])
    rollouts = max(1, round(each / scenes))
    within = _unit_variance(a, b, THESE, paired)[2] if scope == NEW else variance
    between = max(0.0, variance - within)
    if not variance + sum(part for part, _ in trained):  # all are alike: see `p_value`
        way, present = ("scenes", scenes) if scope == NEW else ("rollouts", rollouts)
        alike = math.log(2 / SIGNIFICANT) / math.log1p(difference)  # units
        return {way: max(present, math.floor(alike * present / len(units))) + 1}

    def of_rollouts(count: int) -> Parts:
        more = freedom if scope == NEW else freedom * count / rollouts
        return [*now, (between + within * rollouts / count, more)]

    def of_scenes(count: int) -> Parts:
        return [*now, (variance * scenes / count, count - 1)]

    def of_trainings(count: int) -> Parts:
        parts = [(part * present / count, count - 1.0) for part, present in trained]
        return [*parts, (variance, freedom)]

    ways: dict[str, tuple[int, Callable[[int], Parts]]] = {}
    if not is_thin(a, b):  # else it is not known how much the rollouts in a scene differ
        ways["rollouts"] = (rollouts, of_rollouts)
    if scope == NEW:
        ways["scenes"] = (scenes, of_scenes)
    if min(values.shape[:-1]) > 1:
        ways["trainings"] = (min(values.shape[:-1]), of_trainings)
    return {name: _enough(difference, *way) for name, way in ways.items()}


def _unit_variance(
    a: list[Rollout], b: list[Rollout], scope: str, paired: bool
) -> tuple[np.ndarray, Units, float, float]:
    """Return values and units, see `_linear_parts`, and the units' variance and its freedom."""
    values, units, strata = _linear_parts(a, b, scope, paired)
    means = values.reshape(-1, len(units)).mean(axis=0)
    _, variance, freedom = moments(means, places=list(map(repr, units)), groups=strata)
    return values, units, variance, freedom


def _enough(difference: float, count: int, parts: Callable[[int], Parts]) -> int | None:
    counts = range(count + 1, MOST_TIMES * count + 1)
    place = bisect_left(counts, True, key=lambda n: difference > least_difference(parts(n)))
    return counts[place] if place < len(counts) else None

"""Two entries on the same roads: paired drives, differences and the training seeds needed."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from scipy import special

from zoo.base.errors import InputError
from zoo.benchmark.checked_result import read_result, roads_of, shown
from zoo.benchmark.result import BenchmarkResult, DriveRecord
from zoo.benchmark.suite import Road
from zoo.drives.bootstrap import FEWEST_ROADS, Estimate, bootstrap, mean
from zoo.drives.intervals import wilson_interval

A_BETTER, B_BETTER, CANNOT_TELL = "A drives better", "B drives better", "cannot tell"
LAPS = "laps"  # left out of the overall figures, as in the benchmark's headline
OVERALL = "all but laps"
POWER = 0.8  # probability that a comparison with the needed training seeds decides
MOST_SEEDS = 100
EQUAL = 1e-9  # greatest difference of equal figures, by rounding


@dataclass(frozen=True)
class Entry:
    """A result, with its drives by road; each road has one drive for each training seed."""

    path: Path
    result: BenchmarkResult
    drives: dict[Road, list[DriveRecord]]

    @property
    def seeds(self) -> int:
        """Return the number of training seeds."""
        return len(self.result.checkpoints)

    @property
    def is_trained(self) -> bool:
        """Return whether a training made it; a baseline has no checkpoint file with a hash."""
        return any(one.sha256 is not None for one in self.result.checkpoints)

    def table(self, figure: str, roads: list[Road]) -> np.ndarray:
        """Return a figure of the drives, float64 [training seeds, roads]."""
        values = [[one.figures[figure] for one in self.drives[road]] for road in roads]
        return np.array(values, np.float64).T


def read_pair(first: Path, second: Path) -> tuple[Entry, Entry]:
    """Return the entries of two results that drove the same roads.

    Args:
        first: A's `result.json`, or its folder.
        second: B's `result.json`, or its folder.

    Raises:
        InputError: a file cannot be read, a drive is missing, or suite or roads differ.
    """
    results = ((path, read_result(path)) for path in (first, second))
    a, b = (Entry(path, result, roads_of(result)) for path, result in results)
    for key in ("suite", "roads"):
        own, other = getattr(a.result, key), getattr(b.result, key)
        if own != other:
            raise InputError(
                f"{b.path}: {key}: is {other}, but {a.path} has {own}; compare results of one "
                "suite, driven by one version of drivezoo"
            )
    for one, other in ((a, b), (b, a)):
        if missing := one.drives.keys() - other.drives.keys():
            raise InputError(
                f"{other.path}: drives: has no {shown(min(missing))}, which {one.path} has; run "
                "the benchmark again"
            )
    return a, b


@dataclass(frozen=True)
class Needed:
    """The training seeds of each entry that would decide which entry drives better.

    Attributes:
        seeds: number of training seeds of each entry; None unless the reason is `seeds`.
        reason: `seeds`, a number is needed; `decided`, the present seeds decide; `equal`, both
            means are the same; `roads`, more roads are needed, because the difference varies too
            much between them; `many`, more than 100 are needed; `unknown`, an entry has one seed,
            so the differences between trainings are unknown.
    """

    seeds: int | None
    reason: Literal["seeds", "decided", "equal", "roads", "many", "unknown"]


@dataclass(frozen=True)
class Comparison:
    """Two entries on the same roads.

    Attributes:
        roads: number of drives of each training seed.
        a: A's mean autonomy and mean cross-track error in metres.
        b: B's.
        autonomy: mean difference, A minus B.
        cte_mean_m: mean difference in metres, A minus B; A is nearer to the centre below 0.
        a_better: probability that a training of A has a higher autonomy than one of B on the same
            road; equal autonomy counts half.
        verdict: `A drives better`, `B drives better`; `cannot tell` if the interval of `autonomy`
            contains 0.
        needed: training seeds that would decide.
    """

    roads: int
    a: dict[str, float]
    b: dict[str, float]
    autonomy: Estimate
    cte_mean_m: Estimate
    a_better: Estimate
    verdict: str
    needed: Needed


def compare_entries(a: Entry, b: Entry) -> dict[str, Comparison]:
    """Return the comparison of each group, and of all groups but the laps as `OVERALL`."""
    groups: dict[str, list[Road]] = {}
    for road in a.drives:
        groups.setdefault(road.group, []).append(road)
    overall = [road for road in a.drives if road.group != LAPS]
    if overall and len(groups) > 1:
        groups[OVERALL] = overall
    return {name: compare_roads(a, b, roads) for name, roads in groups.items()}


def compare_roads(a: Entry, b: Entry, roads: list[Road]) -> Comparison:
    """Return the comparison on some roads."""
    autonomy_a, autonomy_b = (one.table("autonomy", roads) for one in (a, b))
    error_a, error_b = (one.table("cte_mean_m", roads) for one in (a, b))
    difference = _estimate(_differences(autonomy_a, autonomy_b), (-1, 1))
    verdict = verdict_on(difference)
    if verdict != CANNOT_TELL:
        needed = Needed(None, "decided")
    elif len(roads) < FEWEST_ROADS:
        needed = Needed(None, "roads")
    elif any(one.seeds == 1 and one.is_trained for one in (a, b)):
        needed = Needed(None, "unknown")
    else:
        needed = seeds_needed(autonomy_a, autonomy_b)
    return Comparison(
        roads=len(roads),
        a={"autonomy": float(autonomy_a.mean()), "cte_mean_m": float(error_a.mean())},
        b={"autonomy": float(autonomy_b.mean()), "cte_mean_m": float(error_b.mean())},
        autonomy=difference,
        cte_mean_m=bootstrap(_differences(error_a, error_b), mean),
        a_better=probability_of_better(autonomy_a, autonomy_b),
        verdict=verdict,
        needed=needed,
    )


def verdict_on(difference: Estimate) -> str:
    """Return which entry drives better, by the interval of A's figure minus B's.

    >>> verdict_on(Estimate(0.2, 0.1, 0.3)), verdict_on(Estimate(0.2, -0.1, 0.5))
    ('A drives better', 'cannot tell')
    """
    if difference.low > 0:
        return A_BETTER
    return B_BETTER if difference.high < 0 else CANNOT_TELL


def probability_of_better(a: np.ndarray, b: np.ndarray) -> Estimate:
    """Estimate the probability that a training of A has a higher figure than one of B.

    Formula: mean over roads of P(A > B) + P(A = B) / 2, each over all pairs of training seeds.

    Source: Agarwal et al. 2021, arXiv:2108.13264, probability of improvement.

    Args:
        a: A's figures, float64 [training seeds, roads].
        b: B's figures, float64 [training seeds, roads].
    """
    differences = _differences(a, b)
    return _estimate((differences > 0) + (differences == 0) / 2, (0, 1))


def seeds_needed(a: np.ndarray, b: np.ndarray) -> Needed:
    """Estimate how many training seeds of each entry would decide, with a probability of 80 %.

    It takes the seen difference and the seen variances for the true ones. From few seeds this is a
    rough number. An entry with one seed counts as one that no training varies.

    Args:
        a: A's figures, float64 [training seeds, roads].
        b: B's figures, float64 [training seeds, roads].
    """
    difference = abs(float(a.mean() - b.mean()))
    if difference < EQUAL:
        return Needed(None, "equal")
    roads = a.shape[1]
    (between_a, noise_a), (between_b, noise_b) = _variances(a), _variances(b)
    of_roads = 0.0
    if roads > 1:
        seen = float((a.mean(axis=0) - b.mean(axis=0)).var(ddof=1))
        of_roads = max(0.0, seen - noise_a / len(a) - noise_b / len(b)) / roads
    no_training = len(a) == len(b) == 1
    if no_training or difference <= _least_difference([(of_roads, roads - 1)]):
        return Needed(None, "roads")
    for seeds in range(min(len(a), len(b)) + 1, MOST_SEEDS + 1):
        parts = [(between_a / seeds, seeds - 1), (between_b / seeds, seeds - 1)]
        if difference > _least_difference([*parts, (of_roads, roads - 1)]):
            return Needed(seeds, "seeds")
    return Needed(None, "many")


def _estimate(values: np.ndarray, limits: tuple[float, float]) -> Estimate:
    """Return the mean with its bootstrap interval, widened if all n roads are equal.

    The share of further roads that differ from them then has Wilson's interval of 0 of n. The
    bounds are the means with the greatest such share at a limit.
    """
    found = bootstrap(values, mean, limits=limits)
    if math.isnan(found.low) or found.high - found.low > EQUAL:
        return found
    share = wilson_interval(0, values.shape[-1])[1]
    low, high = (found.value + share * (limit - found.value) for limit in limits)
    return Estimate(found.value, low, high)


def _differences(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return A's figures minus B's: [seeds of A, seeds of B, roads]."""
    return a[:, None] - b[None]


def _variances(figures: np.ndarray) -> tuple[float, float]:
    """Return the variance of the seeds' means over the roads, and that of a drive's noise."""
    seeds, roads = figures.shape
    if seeds < 2:
        return 0.0, 0.0
    of_seeds, of_roads = figures.mean(axis=1, keepdims=True), figures.mean(axis=0)
    noise = ((figures - of_seeds - of_roads + figures.mean()) ** 2).sum()
    return float(of_seeds.var(ddof=1)), float(noise) / ((seeds - 1) * max(roads - 1, 1))


def _least_difference(parts: list[tuple[float, int]]) -> float:
    """Return the true difference that a comparison with these variances decides in 80 % of cases.

    Args:
        parts: variance and degrees of freedom of each part of the difference's variance.
    """
    known = [(variance, freedom) for variance, freedom in parts if variance > 0]
    total = sum(variance for variance, _ in known)
    if not total:
        return 0.0
    freedom = total**2 / sum(variance**2 / freedom for variance, freedom in known)
    return math.sqrt(total) * float(special.stdtrit(freedom, 0.975) + special.ndtri(POWER))

"""Entries on the same roads: paired drives, differences, ranks and the training seeds needed."""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Literal

import numpy as np
from scipy import special

from zoo.base.errors import InputError
from zoo.driving.clustered import EQUAL, SHARE, clustered, holm, p_value, satterthwaite
from zoo.driving.intervals import FEWEST_ROADS, Estimate
from zoo.results.checked_result import read_result, roads_of, shown
from zoo.results.result import BenchmarkResult, DriveRecord
from zoo.results.suite import LAPS, OVERALL, Road, place_of
from zoo.results.summary import overall

A_BETTER, B_BETTER, CANNOT_TELL = "A drives better", "B drives better", "cannot tell"
RANKED, ONE_SEED, BASELINE = "ranked", "one training seed", "baseline"
SIGNIFICANT = 0.05
POWER = 0.8  # probability that a comparison with the needed training seeds decides
MOST_SEEDS = 100


@dataclass(frozen=True)
class Entry:
    """A result, and the path that it was read from."""

    path: Path
    result: BenchmarkResult

    @cached_property
    def drives(self) -> dict[Road, list[DriveRecord]]:
        """Return the drives by road; each road has one drive for each training seed."""
        return roads_of(self.result)

    @property
    def seeds(self) -> int:
        """Return the number of training seeds; 0 for a baseline: its driver has no hash."""
        return sum(checkpoint.sha256 is not None for checkpoint in self.result.checkpoints)

    @property
    def training_seeds(self) -> list[int | None]:
        """Return the seed of each training; None where it is unknown."""
        return [checkpoint.training_seed for checkpoint in self.result.checkpoints]

    @property
    def kind(self) -> str:
        """Return RANKED for several trainings, ONE_SEED or BASELINE."""
        return {0: BASELINE, 1: ONE_SEED}.get(self.seeds, RANKED)

    @property
    def roads(self) -> list[Road]:
        """Return all roads but the laps; the laps where there are no others."""
        return [road for road in self.drives if road.group != LAPS] or list(self.drives)

    def scores(self, roads: list[Road]) -> np.ndarray:
        """Return the scores of the drives, float64 [training seeds, roads]; 1 is best.

        See `BenchmarkResult.score`.
        """
        rows = [self.drives[road] for road in roads]
        if self.result.has_levels:
            return np.array([[drive.is_clean for drive in row] for row in rows]).T * 1.0
        return np.array([[drive.figures["autonomy"] for drive in row] for row in rows], float).T


def read_entries(*paths: Path) -> list[Entry]:
    """Return the entries of results that drove the same roads.

    Args:
        *paths: files `result.json`, or their folders.

    Raises:
        InputError: a file cannot be read, a drive is missing, or suite or roads differ.
    """
    entries = [Entry(path, read_result(path)) for path in paths]
    for entry, other in itertools.permutations(entries, 2):
        for key in ("suite", "roads", "usual"):
            wanted, value = getattr(entry.result, key), getattr(other.result, key)
            if wanted and value and wanted != value:  # an older result lacks what is usual
                raise InputError(
                    f"{other.path}: {key}: is {value}, but {entry.path} has {wanted}; compare "
                    "results of one suite, driven by one version of drivezoo"
                )
        if missing := entry.drives.keys() - other.drives.keys():
            raise InputError(
                f"{other.path}: drives: has no {shown(min(missing))}, which {entry.path} has; run "
                "the benchmark again"
            )
    return entries


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
        a: A's mean score, by the name of the figure; see `BenchmarkResult.score`.
        b: B's.
        difference: mean difference of the scores, A minus B.
        a_better: probability that a training of A has a higher score than one of B on the same
            road; equal ones count half.
        p: p-value of `difference`, 0..1, corrected for the number of groups (Holm); that of all
            groups but the laps stands for itself. 1 for fewer than three places.
        verdict: `A drives better`, `B drives better`; `cannot tell` if `p` is 0.05 or more, or an
            entry has one training alone.
        needed: training seeds that would decide.
    """

    roads: int
    a: dict[str, float]
    b: dict[str, float]
    difference: Estimate
    a_better: Estimate
    p: float
    verdict: str
    needed: Needed


def shared_seeds(a: Entry, b: Entry) -> list[int]:
    """Return the known training seeds that two entries have, each once.

    Raises:
        InputError: they have none.
    """
    of_a, of_b = (
        [seed for seed in dict.fromkeys(side.training_seeds) if seed is not None] for side in (a, b)
    )
    if shared := [seed for seed in of_a if seed in of_b]:
        return shared
    seeds = [", ".join(map(str, jobs)) or "none" for jobs in (of_a, of_b)]
    raise InputError(
        f"paired=true: {a.path} has the training seeds {seeds[0]}, {b.path} {seeds[1]}; a pair is "
        "two trainings of one seed"
    )


def compare_entries(a: Entry, b: Entry, paired: bool = False) -> dict[str, Comparison]:
    """Return the comparison of each group, and of all groups but the laps as `OVERALL`.

    With `paired`, trainings of the same seed are pairs, which leaves out what they share; others do
    not count.
    """
    groups: dict[str, list[Road]] = {}
    for road in a.drives:
        groups.setdefault(road.group, []).append(road)
    overall = [road for road in a.drives if road.group != LAPS]
    if overall and len(groups) > 1:
        groups[OVERALL] = overall
    p_values = {name: _p_value(a, b, roads, paired) for name, roads in groups.items()}
    tested = [name for name, roads in groups.items() if name != OVERALL and _has_interval(roads)]
    p_values |= zip(tested, holm([p_values[name] for name in tested]), strict=True)
    return {
        name: compare_roads(a, b, roads, p_values[name], paired) for name, roads in groups.items()
    }


def compare_pairs(entries: Sequence[Entry]) -> dict[tuple[int, int], Comparison]:
    """Return the comparison over all groups but the laps of each pair, by the entries' numbers.

    The p-values, and the verdicts, are corrected for the number of pairs (Holm).
    """
    pairs = list(itertools.combinations(range(len(entries)), 2))
    overall = [[*compare_entries(entries[a], entries[b]).values()][-1] for a, b in pairs]
    return {
        pair: replace(group, p=p, verdict=group.verdict if p < SIGNIFICANT else CANNOT_TELL)
        for pair, group, p in zip(pairs, overall, holm([group.p for group in overall]), strict=True)
    }


def in_order(entries: Sequence[Entry]) -> list[Entry]:
    """Return entries, those with ranks first and baselines last, by interventions per km.

    Entries that drove levels stand by their share of clean drives.
    """

    def key(entry: Entry) -> tuple[int, float]:
        name, sign = "interventions_per_km", 1
        if entry.result.has_levels:
            name, sign = entry.result.score, -1
        value = overall(entry.result)[name].value
        kinds = (RANKED, ONE_SEED, BASELINE)
        return kinds.index(entry.kind), math.inf if value is None else sign * value

    return sorted(entries, key=key)


def possible_ranks(pairs: Mapping[tuple[int, int], Comparison], count: int) -> list[str]:
    """Return the ranks that each of some compared entries may have, such as `2 to 4`."""
    above, below = [0] * count, [0] * count
    for (a, b), group in pairs.items():
        if group.verdict != CANNOT_TELL:
            better, worse = (a, b) if group.verdict == A_BETTER else (b, a)
            above[worse] += 1
            below[better] += 1
    bounds = [(1 + ahead, count - behind) for ahead, behind in zip(above, below, strict=True)]
    return [f"{first} to {last}" if first < last else f"{first}" for first, last in bounds]


def _has_interval(roads: list[Road]) -> bool:
    return len(set(clusters(roads)[0])) >= FEWEST_ROADS


def _p_value(a: Entry, b: Entry, roads: list[Road], paired: bool) -> float:
    """Return the p-value of the difference in the scores; 1 for too few places."""
    if not _has_interval(roads):
        return 1.0
    scores_a, scores_b = _scores(a, b, roads, paired)
    return p_value(_difference(scores_a, scores_b, paired), *clusters(roads))


def _scores(a: Entry, b: Entry, roads: list[Road], paired: bool) -> list[np.ndarray]:
    """Return the scores of both entries, [training seeds, roads]; of pairs, of shared seeds.

    Trainings of one entry that have the same seed count as one, by their mean.
    """
    tables = [side.scores(roads) for side in (a, b)]
    if not paired:
        return tables
    shared = shared_seeds(a, b)
    return [
        np.array([table[np.array(side.training_seeds) == seed].mean(axis=0) for seed in shared])
        for table, side in zip(tables, (a, b), strict=True)
    ]


def _difference(scores_a: np.ndarray, scores_b: np.ndarray, paired: bool) -> np.ndarray:
    """Return A's scores minus B's, [seeds of A, seeds of B, roads]; of pairs, [seeds, roads]."""
    return scores_a - scores_b if paired else scores_a[:, None] - scores_b


def clusters(roads: Sequence[Road]) -> tuple[list[str], list[str]]:
    """Return the places and the groups of drives."""
    return [place_of(road.track) for road in roads], [road.group for road in roads]


def compare_roads(
    a: Entry, b: Entry, roads: list[Road], p: float | None = None, paired: bool = False
) -> Comparison:
    """Return the comparison on some roads; with a p-value that is corrected for their number."""
    places, groups = clusters(roads)
    scores_a, scores_b = _scores(a, b, roads, paired)
    difference = _difference(scores_a, scores_b, paired)
    p = _p_value(a, b, roads, paired) if p is None else p
    verdict = CANNOT_TELL
    # Of pairs, only the shared seeds count.
    alone = any(len(scores) == 1 and side.seeds for side, scores in ((a, scores_a), (b, scores_b)))
    if p < SIGNIFICANT and not alone:
        verdict = A_BETTER if difference.mean() > 0 else B_BETTER
    if verdict != CANNOT_TELL:
        needed = Needed(None, "decided")
    elif not _has_interval(roads):
        needed = Needed(None, "roads")
    elif alone:
        needed = Needed(None, "unknown")
    else:
        tables = (difference, 0 * difference) if paired else (scores_a, scores_b)
        needed = seeds_needed(*(_by_place(table, places) for table in tables))
    estimate = partial(clustered, places=places, groups=groups)
    return Comparison(
        roads=len(roads),
        a={a.result.score: float(scores_a.mean())},
        b={b.result.score: float(scores_b.mean())},
        difference=estimate(difference, limits=(-1, 1)),
        # Agarwal et al. 2021, arXiv:2108.13264: the probability of improvement.
        a_better=estimate((difference > 0) + (difference == 0) / 2, limits=SHARE),
        p=p,
        verdict=verdict,
        needed=needed,
    )


def seeds_needed(a: np.ndarray, b: np.ndarray) -> Needed:
    """Estimate how many training seeds of each entry would decide, with a probability of 80 %.

    It takes the seen difference and the seen variances for the true ones. From few seeds this is a
    rough number. An entry with one seed counts as one that no training varies.

    Args:
        a: A's figures, float64 [training seeds, places].
        b: B's figures, float64 [training seeds, places]; two places or more.
    """
    difference = abs(float(a.mean() - b.mean()))
    if difference < EQUAL:
        return Needed(None, "equal")
    roads = a.shape[1]
    (between_a, noise_a), (between_b, noise_b) = _variances(a), _variances(b)
    seen = float((a.mean(axis=0) - b.mean(axis=0)).var(ddof=1))
    of_roads = max(0.0, seen - noise_a / len(a) - noise_b / len(b)) / roads
    # Where trainings do not vary, their number changes no p-value.
    alike = between_a + between_b <= EQUAL**2
    if alike or difference <= least_difference([(of_roads, roads - 1)]):
        return Needed(None, "roads")
    for seeds in range(min(len(a), len(b)) + 1, MOST_SEEDS + 1):
        parts = [(between_a / seeds, seeds - 1), (between_b / seeds, seeds - 1)]
        if difference > least_difference([*parts, (of_roads, roads - 1)]):
            return Needed(seeds, "seeds")
    return Needed(None, "many")


def _by_place(table: np.ndarray, places: Sequence[str]) -> np.ndarray:
    """Return drives [seeds, drives] as places [seeds, places] with the same mean."""
    order = list(dict.fromkeys(places))
    sums = np.zeros((len(table), len(order)))
    np.add.at(sums.T, [order.index(place) for place in places], table.T)
    return sums * len(order) / len(places)


def _variances(figures: np.ndarray) -> tuple[float, float]:
    """Return the variance of the seeds' means over the roads, and that of a drive's noise."""
    seeds, roads = figures.shape
    if seeds < 2:
        return 0.0, 0.0
    of_seeds, of_roads = figures.mean(axis=1, keepdims=True), figures.mean(axis=0)
    noise = ((figures - of_seeds - of_roads + figures.mean()) ** 2).sum()
    return float(of_seeds.var(ddof=1)), float(noise) / ((seeds - 1) * max(roads - 1, 1))


def least_difference(parts: Sequence[tuple[float, float]]) -> float:
    """Return the true difference that a comparison with these variances decides in 80 % of cases.

    Args:
        parts: variance and degrees of freedom of each part of the difference's variance.
    """
    varying = [(variance, freedom) for variance, freedom in parts if variance > 0]
    if not varying:
        return 0.0
    critical = special.stdtrit(satterthwaite(varying), 0.975) + special.ndtri(POWER)
    return math.sqrt(sum(variance for variance, _ in varying)) * float(critical)

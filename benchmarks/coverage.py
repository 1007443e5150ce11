"""How often the benchmark's intervals contain the truth, on simulated drives of its suites.

Of the suite v1:
Most places have no intervention, some have several: the variance of the counts is two to four times
their mean, as in the board's entries. The drives of a place share a factor, and so do those of a
training; the counts are Poisson's. A place of `sharp` has twice the interventions of another.

Of the suite v2: whether a drive is clean falls with its level by a logistic curve, which a place
and a training move.
"""

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial

import numpy as np
from scipy import optimize, special

from benchmarks.measuring import markdown_table
from zoo.driving.bootstrap import Estimate, bootstrap, poisson_rate
from zoo.driving.clustered import POSITIVE, SHARE, clustered, p_value
from zoo.results.levels import level_at
from zoo.results.suite import LAPS, place_of, read_suite


@dataclass(frozen=True)
class Drives:
    """Simulated drives.

    Attributes:
        seeds: number of training seeds.
        mean: expected interventions of a drive.
        hard: share of the places where interventions occur.
        by_seed: standard deviation of the logarithm of a training's factor.
    """

    seeds: int
    mean: float
    hard: float
    by_seed: float = 0.3

    def draw(self, rng: np.random.Generator, entries: int = 1) -> Iterator[np.ndarray]:
        """Yield the interventions of entries on the same places, float64 [seeds, drives]."""
        _, place = np.unique(suite()[0], return_inverse=True)
        sharp = np.where(np.array(suite()[1]) == "sharp", 2.0, 1.0)
        hard = rng.random(place.max() + 1) < self.hard
        # One training is a rate of its own, whose interval leaves out how trainings differ.
        spread = self.by_seed if self.seeds > 1 else 0.0
        for _ in range(entries):
            rates = self.mean * (hard * rng.exponential(size=len(hard)) / self.hard)[place]
            trained = np.exp(spread * rng.normal(size=(self.seeds, 1)) - spread**2 / 2)
            yield rng.poisson(rates * sharp / sharp.mean() * trained).astype(float)


CASES = [
    Drives(seeds, mean, hard)
    for seeds in (1, 3, 5)
    for mean, hard in ((0.05, 0.2), (0.2, 0.2), (0.5, 0.3), (1.0, 0.5))
]


@cache
def suite() -> tuple[list[str], list[str]]:
    """Return the place and the group of each drive of v1 but the laps."""
    drives = [one for one in read_suite("v1").drives if one.group != LAPS]
    return [one.track for one in drives], [one.group for one in drives]


def estimate(drawn: np.ndarray, limits: tuple[float, float] = POSITIVE) -> Estimate:
    """Return the mean of drives, such as their interventions, with the benchmark's interval."""
    places, groups = suite()
    return clustered(drawn, places=places, groups=groups, limits=limits, one_failure=1.0)


def of_group(group: str, drawn: np.ndarray) -> Estimate:
    """Return the interventions of a drive of a group with the benchmark's interval."""
    chosen = [number for number, one in enumerate(suite()[1]) if one == group]
    places = [suite()[0][number] for number in chosen]
    return clustered(drawn[:, chosen], places=places, limits=POSITIVE, one_failure=1.0)


METHODS: dict[str, Callable[[np.ndarray], Estimate]] = {
    "interventions": estimate,
    "drives with one": lambda drawn: estimate((drawn > 0) * 1.0, SHARE),
    "interventions, `looks`": partial(of_group, "looks"),
    "Garwood": lambda drawn: poisson_rate(int(drawn.sum()), drawn.size),
    "bootstrap over drives": lambda drawn: bootstrap(drawn.mean(0), 500, (0.0, np.inf)),
}


def contained(case: Drives, truths: Mapping[str, float], count: int) -> list[float]:
    """Return the share of simulated suites whose interval contains the truth, by method."""
    rng, hits = np.random.default_rng(1), np.zeros(len(truths))
    for _ in range(count):
        (drawn,) = case.draw(rng)
        found = [(METHODS[name](drawn), truth) for name, truth in truths.items()]
        hits += [one.low <= truth <= one.high for one, truth in found]
    return (hits / count).tolist()


def told_apart(case: Drives, count: int) -> float:
    """Return the share of pairs of equal entries of which one is found to drive better."""
    rng, found = np.random.default_rng(2), 0
    for _ in range(count):
        a, b = (np.maximum(0.0, 1 - 6 * one / 20) for one in case.draw(rng, 2))
        found += p_value(a[:, None] - b[None], *suite()) < 0.05
    return found / count


def coverage(count: str = "1000") -> None:
    """Print how often intervals contain the truth, as a Markdown table: `coverage [COUNT]`."""
    lines = []
    for case in CASES:
        rng = np.random.default_rng(0)
        drawn = np.array([next(case.draw(rng)) for _ in range(4000)])
        overdispersion = np.mean([one.var() / one.mean() for one in drawn if one.any()])
        cells = [str(case.seeds), f"{case.mean:g}", f"{overdispersion:.1f}"]
        truths = dict.fromkeys(METHODS, case.mean) | {"drives with one": (drawn > 0).mean()}
        truths["interventions, `looks`"] = drawn[..., np.array(suite()[1]) == "looks"].mean()
        shares = [*contained(case, truths, int(count)), told_apart(case, int(count))]
        lines.append([*cells, *(f"{share:.1%}" for share in shares)])
    head = ["seeds", "interventions of a drive", "variance / mean", *METHODS, "equal told apart"]
    print(markdown_table(head, lines, left=0))


@dataclass(frozen=True)
class Leveled:
    """Simulated drives of levels.

    Attributes:
        seeds: number of training seeds.
        share: expected share of clean drives.
        slope: fall of the log odds from one level to the next.
        by_place: standard deviation of the level that a place adds.
        by_seed: standard deviation of the level that a training adds.
    """

    seeds: int
    share: float
    slope: float = 1.5
    by_place: float = 0.8
    by_seed: float = 0.4

    @cached_property
    def middle(self) -> float:
        """Return the level at which half the drives of a usual place and training are clean."""
        return self._solve(lambda middle: self._shares(middle, levels()[0]).mean() - self.share)

    def level(self, share: float) -> float:
        """Return the level at which a share of the drives is clean, within half a level."""
        found = self._solve(lambda level: share - self._shares(self.middle, [level]).mean())
        return float(np.clip(found, 0.5, 5.5))

    def places(self, rng: np.random.Generator) -> np.ndarray:
        """Return the level that the place of each drive adds, float64 [drives]."""
        _, place = np.unique(levels()[1], return_inverse=True)
        return self.by_place * rng.normal(size=place.max() + 1)[place]

    def draw(self, rng: np.random.Generator, easier: np.ndarray) -> np.ndarray:
        """Return whether the drives on some places are clean, float64 [seeds, drives]."""
        trained = self._by_seed * rng.normal(size=(self.seeds, 1))
        odds = self.slope * (self.middle + easier + trained - levels()[0])
        return (rng.random(odds.shape) < special.expit(odds)) * 1.0

    @property
    def _by_seed(self) -> float:
        # As for v1, one training is a share of its own.
        return self.by_seed if self.seeds > 1 else 0.0

    def _shares(self, middle: float, level: Sequence[float]) -> np.ndarray:
        drawn = np.random.default_rng(0).normal(size=4000)
        moved = math.hypot(self.by_place, self._by_seed) * drawn
        return special.expit(self.slope * (middle + moved[:, None] - np.asarray(level)))

    @staticmethod
    def _solve(difference: Callable[[float], float]) -> float:
        return float(optimize.brentq(difference, -20, 30))


@cache
def levels() -> tuple[np.ndarray, list[str], list[str]]:
    """Return the level, the place and the group of each drive of v2."""
    drives = read_suite("v2").drives
    level = np.array([one.level for one in drives])
    return level, [place_of(one.track) for one in drives], [one.group for one in drives]


def level_coverage(count: str = "400") -> None:
    """Print how often v2's intervals contain the truth: `level_coverage [COUNT]`.

    *told apart* is the share of pairs of entries of which one is found to drive better: of equal
    ones, and of one that fails twice as often.
    """
    lines = []
    level, places, groups = levels()
    axis = np.array(groups) == groups[0]
    own = [place for place, one in zip(places, axis, strict=True) if one]
    for seeds, share in itertools.product((1, 3, 5), (0.6, 0.8, 0.95, 0.98)):
        case, rng = Leveled(seeds, share), np.random.default_rng(1)
        worse, hits, known = replace(case, share=2 * share - 1), np.zeros(5), np.zeros(5)
        truths = [1 - share, case.level(0.5), case.level(0.9)]
        for _ in range(int(count)):
            easier = case.places(rng)
            clean = case.draw(rng, easier)
            found = [
                clustered(1 - clean, places=places, groups=groups, limits=SHARE, one_failure=1.0),
                *(level_at(one, clean[:, axis], level[axis], own) for one in (0.5, 0.9)),
            ]
            others = [clean[:, None] - other.draw(rng, easier) for other in (case, worse)]
            hits += [
                *(one.low <= truth <= one.high for one, truth in zip(found, truths, strict=True)),
                *(p_value(one, places, groups) < 0.05 for one in others),
            ]
            known += [*(math.isfinite(one.low) for one in found), 1, 1]
        shares = [f"{one / own:.1%}" if own else "-" for one, own in zip(hits, known, strict=True)]
        lines.append([str(seeds), f"{share:.0%}", *shares])
    head = ["seeds", "clean drives", "their share", "level at 50 %", "level at 90 %"]
    head += ["equal told apart", "twice the failures told apart"]
    print(markdown_table(head, lines, left=0))

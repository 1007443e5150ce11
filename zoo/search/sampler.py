"""The choice of the next roads and days to drive."""

import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from zoo.base.errors import InputError
from zoo.search.failure_map import Archive
from zoo.search.search_space import DAYS, Candidate, SearchSpace

if TYPE_CHECKING:
    import optuna

PROPOSALS, TPE_PROPOSALS = 30, 8  # roads that are drawn to find one in a cell without a failure
STEP = 0.15  # standard deviation of a change, as a share of a parameter's range
ATTEMPTS = 20  # draws of parameters until the car can take a road


class RandomSampler:
    """A sampler that draws parameters uniformly from their ranges.

    Args:
        space: roads and days.
        seed: random seed.
        whole_family: draw roads as the family draws them, and only the days uniformly.
    """

    def __init__(self, space: SearchSpace, seed: int, whole_family: bool = False) -> None:
        self.space, self.rng = space, np.random.default_rng(seed)
        self.keys = [key for key in space.parameters if key in DAYS or not whole_family]

    def propose(self, count: int) -> list[Candidate]:
        """Return the next roads to drive."""
        return [self.draw() for _ in range(count)]

    def learn(self, closeness: Sequence[float]) -> None:
        """Take the closeness to failure of the proposed roads' drives."""

    def draw(self) -> Candidate:
        """Return a road that the car can take."""
        for _ in range(ATTEMPTS):
            candidate = self.space.draw(self.rng, self._parameters())
            if candidate is not None:
                return candidate
        raise no_road(self.space)

    def _parameters(self) -> dict[str, float]:
        return {key: self.space.parameters[key].at(self.rng.random()) for key in self.keys}


class ArchiveSampler:
    """A sampler that draws from three sources, and most from the one that finds new cells.

    The sources are the family's own roads, parameters drawn uniformly, and changed parameters of
    earlier failures, as in MAP-Elites (Mouret and Clune 2015, "Illuminating search spaces by
    mapping elites", arXiv:1504.04909). Thompson sampling chooses among them, by the share of their
    drives that failed in a new cell. A road is drawn in 10 ms, and driven only if its cell has no
    failure yet, since a drive takes seconds.

    Args:
        space: roads and days.
        seed: random seed.
        archive: cells of the search, which the caller keeps up to date.
    """

    def __init__(self, space: SearchSpace, seed: int, archive: Archive) -> None:
        self.space, self.archive, self.rng = space, archive, np.random.default_rng(seed)
        family, uniform = (RandomSampler(space, seed, whole) for whole in (True, False))
        family.rng = uniform.rng = self.rng
        self.sources = [family.draw, uniform.draw, self._changed]
        self.found, self.missed = np.ones(3), np.ones(3)  # drives of each source; new cells, others
        self.failures: list[dict[str, float]] = []
        self.proposed: list[tuple[int, bool, Candidate]] = []  # source; whether its cell is new

    def propose(self, count: int) -> list[Candidate]:
        """Return the next roads to drive, in cells without a failure as far as any are found."""
        self.proposed, taken = [], set(self.archive.failed)
        usable = len(self.sources) if self.failures else len(self.sources) - 1
        for _ in range(count):
            chances = self.rng.beta(self.found[:usable], self.missed[:usable])
            source = int(chances.argmax())
            for _ in range(PROPOSALS):
                candidate = self.sources[source]()
                cell = self.archive.grid.cell(candidate.features)
                if cell not in taken:
                    break
            self.proposed.append((source, cell not in taken, candidate))
            taken.add(cell)
        return [candidate for *_, candidate in self.proposed]

    def learn(self, closeness: Sequence[float]) -> None:
        """Keep failures, and count each source's drives that failed in a new cell."""
        for (source, is_new, candidate), one in zip(self.proposed, closeness, strict=True):
            failed = one == 1
            (self.found if failed and is_new else self.missed)[source] += 1
            if failed:
                self.failures.append(candidate.parameters)

    def _changed(self) -> Candidate:
        """Return a road with changed parameters of a failure."""
        ranges = self.space.parameters
        for _ in range(ATTEMPTS):
            parent = self.failures[self.rng.integers(len(self.failures))]
            steps = {key: self.rng.normal(0, STEP) for key in ranges}
            changed = {
                key: one.at(one.share(parent[key]) + steps[key]) for key, one in ranges.items()
            }
            if (candidate := self.space.draw(self.rng, changed)) is not None:
                return candidate
        raise no_road(self.space)


class TpeSampler:
    """A sampler of Optuna's TPE, which proposes parameters that resemble those of failures.

    As in `ArchiveSampler`, only roads in cells without a failure are driven.

    Args:
        space: roads and days.
        seed: random seed.
        archive: cells of the search, which the caller keeps up to date.
        startup: number of first drives, which are at random.

    Raises:
        InputError: Optuna is not installed.
    """

    def __init__(self, space: SearchSpace, seed: int, archive: Archive, startup: int) -> None:
        try:
            import optuna
        except ImportError:
            raise InputError(
                "sampler=tpe: Optuna is not installed; pip install 'drivezoo[optuna]', or use "
                "sampler=random"
            ) from None
        self.space, self.archive, self.rng = space, archive, np.random.default_rng(seed)
        self.ranges = {
            key: optuna.distributions.FloatDistribution(one.low, one.high, log=one.log)
            for key, one in space.parameters.items()
        }
        self.abandoned = optuna.trial.TrialState.FAIL
        optuna.logging.set_verbosity(optuna.logging.ERROR)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)  # multivariate
            sampler = optuna.samplers.TPESampler(
                seed=seed, n_startup_trials=startup, multivariate=True
            )
        self.study = optuna.create_study(direction="maximize", sampler=sampler)
        self.trials: list[optuna.Trial] = []

    def propose(self, count: int) -> list[Candidate]:
        """Return the next roads to drive, in cells without a failure as far as any are found."""
        self.trials, found = [], []
        taken = set(self.archive.failed)
        for _ in range(count):
            for left in reversed(range(TPE_PROPOSALS)):
                trial, candidate = self._ask()
                cell = self.archive.grid.cell(candidate.features)
                if cell not in taken or not left:
                    break
                self.study.tell(trial, state=self.abandoned)
            taken.add(cell)
            self.trials.append(trial)
            found.append(candidate)
        return found

    def learn(self, closeness: Sequence[float]) -> None:
        """Take the closeness to failure of the proposed roads' drives."""
        for trial, one in zip(self.trials, closeness, strict=True):
            self.study.tell(trial, one)

    def _ask(self) -> "tuple[optuna.Trial, Candidate]":
        for _ in range(ATTEMPTS):
            trial = self.study.ask(self.ranges)
            candidate = self.space.draw(self.rng, trial.params)
            if candidate is not None:
                return trial, candidate
            self.study.tell(trial, state=self.abandoned)
        raise no_road(self.space)


def no_road(space: SearchSpace) -> InputError:
    """Return the error of a family of which the car can take no road."""
    return InputError(
        f"family={space.family.name}: the car could take none of {ATTEMPTS} roads; widen the "
        "family's radius, or set a smaller length="
    )

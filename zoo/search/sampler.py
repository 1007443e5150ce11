"""The choice of the next roads and days to drive."""

import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from datamodules.errors import InputError
from zoo.search.failure_archive import Archive
from zoo.search.search_space import DAYS, Candidate, SearchSpace

if TYPE_CHECKING:
    import optuna

PROPOSALS, TPE_PROPOSALS = 30, 8  # roads that are drawn to find one in a cell without a failure
AT_RANDOM = 0.1  # share of proposals at random after the first drives
PARENTS = 6  # failures from which no drive without a failure is changed any more
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
        return [self._draw() for _ in range(count)]

    def learn(self, closeness: Sequence[float]) -> None:
        """Take the closeness to failure of the proposed roads' drives."""

    def _draw(self) -> Candidate:
        for _ in range(ATTEMPTS):
            candidate = self.space.draw(self.rng, self._parameters())
            if candidate is not None:
                return candidate
        raise no_road(self.space)

    def _parameters(self) -> dict[str, float]:
        return {key: self.space.parameters[key].at(self.rng.random()) for key in self.keys}


class ArchiveSampler(RandomSampler):
    """A sampler that changes the roads and days of earlier failures, as MAP-Elites does.

    Source: Mouret and Clune 2015, "Illuminating search spaces by mapping elites", arXiv:1504.04909.
    A proposal's road is drawn, which takes 10 ms, and driven only if its cell has no failure yet,
    since a drive takes seconds. `benchmarks/search.py` compares the samplers.

    Args:
        space: roads and days.
        seed: random seed.
        archive: cells of the search, which the caller keeps up to date.
        startup: number of first drives, which are at random.
    """

    def __init__(self, space: SearchSpace, seed: int, archive: Archive, startup: int) -> None:
        super().__init__(space, seed)
        self.archive, self.startup = archive, startup
        self.tried: list[tuple[float, dict[str, float]]] = []  # closeness and parameters
        self.proposed: list[Candidate] = []

    def propose(self, count: int) -> list[Candidate]:
        """Return the next roads to drive, in cells without a failure as far as any are found."""
        self.proposed, taken = [], set(self.archive.failed)
        for _ in range(count):
            for _ in range(PROPOSALS):
                candidate = self._draw()
                cell = self.archive.grid.cell(candidate.features)
                if cell not in taken:
                    break
            taken.add(cell)
            self.proposed.append(candidate)
        return self.proposed

    def learn(self, closeness: Sequence[float]) -> None:
        """Keep the parameters of the proposed roads with the closeness of their drives."""
        drives = zip(closeness, self.proposed, strict=True)
        self.tried += [(one, candidate.parameters) for one, candidate in drives]

    def _parameters(self) -> dict[str, float]:
        """Return changed parameters of a failure, or of one of the closest drives if few failed."""
        if len(self.tried) < self.startup or self.rng.random() < AT_RANDOM:
            return super()._parameters()
        failures = [one for one in self.tried if one[0] == 1]
        if len(failures) < PARENTS:
            failures = sorted(self.tried, key=lambda one: -one[0])[:PARENTS]
        _, parent = failures[self.rng.integers(len(failures))]
        ranges = self.space.parameters
        steps = {key: self.rng.normal(0, STEP) for key in ranges}
        return {key: one.at(one.share(parent[key]) + steps[key]) for key, one in ranges.items()}


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

"""A search: its samplers choose the next roads and days, which are driven; kept is which failed."""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from zoo.base.errors import InputError, optional_import
from zoo.base.process_pool import Pool
from zoo.driving.drive_record import Drive
from zoo.driving.run_drives import all_drives
from zoo.driving.scenario import Scenario
from zoo.extras.research.failure_map import Archive
from zoo.extras.research.search_options import SearchOptions
from zoo.extras.research.search_space import DAYS, Candidate, SearchSpace
from zoo.simulator.track import Track

BATCH = 8  # drives that are chosen together, for every number of processes
STARTUP = 0.12  # share of the budget that TPE draws at random first
USUAL_ROADS = 25  # of the family, for the usual values of features
STEP = 0.15  # standard deviation of a change, as a share of a parameter's range
ATTEMPTS = 20  # draws of parameters until the car can take a road

Draw = Callable[[], dict[str, float]]  # returns parameters of a road and its day


@dataclass(frozen=True)
class Outcome:
    """The end of a drive.

    Attributes:
        failed: whether it ended with an intervention.
        driven_m: metres driven.
        time_s: seconds driven.
        closeness: largest share of the way from the centreline to the edge line, below 1; 1 for
            a failure.
        nan_frames: number of frames for which the network steered NaN.
    """

    failed: bool
    driven_m: float
    time_s: float
    closeness: float
    nan_frames: int

    @classmethod
    def of(cls, drive: Drive, track: Track) -> "Outcome":
        """Return the end of a drive that ended at its first intervention."""
        failed = bool(drive.intervention.any())
        # Known in each embedded world; otherwise NaN.
        edge = track.width_at(np.asarray(drive.distance_m, float)) / 2
        closeness = float((np.abs(drive.cross_track_m) / edge).max())
        return cls(
            failed,
            round(drive.driven_m, 3),
            round(float(drive.time_s[-1]), 3),
            1.0 if failed else round(min(closeness, 0.999), 4),
            drive.nan_frames,
        )


@dataclass(frozen=True)
class Driven:
    """A road that was driven, and how the drive ended."""

    candidate: Candidate
    outcome: Outcome


def drive_roads(
    checkpoint: str, options: SearchOptions, pool: Pool, chosen: Sequence[Candidate]
) -> list[Outcome]:
    """Drive roads in the processes of a pool, and return outcomes in their order.

    Raises:
        InputError: a process was killed, for example because memory ran out.
    """
    scenarios = [
        Scenario(
            road=road.content,
            weather=road.weather,
            speed=options.speed,
            frame_rate=options.frame_rate,
            delay_s=options.delay_s,
            quality=options.quality,
        )
        for road in chosen
    ]
    drives = all_drives(checkpoint, scenarios, first_only=True, pool=pool)
    return [Outcome.of(drive, road.track) for drive, road in zip(drives, chosen, strict=True)]


def search(
    options: SearchOptions,
    space: SearchSpace,
    archive: Archive,
    drive: Callable[[Sequence[Candidate]], list[Outcome]],
    report: Callable[[list[Driven]], None],
) -> list[Driven]:
    """Drive `options.budget` roads and return them in the order of their choice.

    The roads are chosen in batches of 8, whose drives may run in parallel. Therefore the search is
    the same for every number of processes.

    Args:
        options: options of the search.
        space: roads and days to choose from.
        archive: empty cells, which are filled.
        drive: function that drives roads, see `drive_roads`.
        report: function called after each batch with all drives so far.
    """
    sampler = make_sampler(options, space, archive)
    driven: list[Driven] = []
    while len(driven) < options.budget:
        chosen = sampler.propose(min(BATCH, options.budget - len(driven)))
        outcomes = drive(chosen)
        for candidate, outcome in zip(chosen, outcomes, strict=True):
            archive.add(candidate.features, outcome.failed)
            driven.append(Driven(candidate, outcome))
        sampler.learn([outcome.closeness for outcome in outcomes])
        report(driven)
    return driven


def usual_features(space: SearchSpace) -> dict[str, float]:
    """Return each feature's median over 25 roads as the family draws them, on a clear day."""
    rng = np.random.default_rng(0)
    roads = [space.draw(rng, {}) for _ in range(USUAL_ROADS)]
    features = [road.features for road in roads if road is not None]
    return {key: float(np.median([values[key] for values in features])) for key in space.features}


def feature_distance(
    first: dict[str, float], second: dict[str, float], space: SearchSpace
) -> float:
    """Return how far two roads are from each other, 0 (the same)..1.

    It is the root mean square, over all features, of their difference as a share of the feature's
    range.
    """
    step = _position(first, space) - _position(second, space)
    return float(np.sqrt(np.mean(np.square(step))))


def sparseness(roads: Sequence[dict[str, float]], space: SearchSpace) -> float | None:
    """Return the mean distance of each road from the one that is farthest from it, 0..1.

    It is the diversity of failures in the SBFT tool competitions (Panichella et al. 2021, "SBST
    tool competition 2021"), here of features instead of the roads' shapes. None for fewer than two.
    """
    if len(roads) < 2:
        return None
    places = np.array([_position(road, space) for road in roads])
    farthest = [np.square(places - position).mean(axis=1).max() for position in places]
    return float(np.mean(np.sqrt(farthest)))


def _position(features: dict[str, float], space: SearchSpace) -> np.ndarray:
    """Return features as shares of their ranges, float64 [features]."""
    return np.array([feature.scale.share(features[key]) for key, feature in space.features.items()])


class Sampler:
    """A sampler that draws parameters uniformly from their ranges.

    Args:
        space: roads and days.
        seed: random seed.
        archive: cells of the search, which the caller keeps up to date.
        whole_family: draw roads as the family draws them, and only the days uniformly.
    """

    proposals = 1  # roads that are drawn to find one in a cell without a failure

    def __init__(
        self, space: SearchSpace, seed: int, archive: Archive, whole_family: bool = False
    ) -> None:
        self.space, self.archive, self.rng = space, archive, np.random.default_rng(seed)
        self.draw = self._family if whole_family else self._uniform
        # Of each proposed road: what drew it, whether its cell is new, and the road.
        self.proposed: list[tuple[Any, bool, Candidate]] = []

    def propose(self, count: int) -> list[Candidate]:
        """Return the next roads to drive, in cells without a failure as far as any are found."""
        self.proposed, taken = [], set(self.archive.failed)
        for _ in range(count):
            draw = self._choose()
            for left in reversed(range(self.proposals)):
                candidate = self._road(draw)
                cell = self.archive.cell(candidate.features)
                if cell not in taken or not left:
                    break
                self._abandon()
            self.proposed.append((self.source, cell not in taken, candidate))
            taken.add(cell)
        return [candidate for *_, candidate in self.proposed]

    def learn(self, closeness: Sequence[float]) -> None:
        """Take the closeness to failure of the proposed roads' drives."""

    def _choose(self) -> Draw:
        """Return what draws the next road, and note it as `source`."""
        self.source: Any = None
        return self.draw

    def _abandon(self) -> None:
        """Take note that the last drawn road is not driven."""

    def _road(self, draw: Draw) -> Candidate:
        """Return a road that the car can take."""
        for _ in range(ATTEMPTS):
            candidate = self.space.draw(self.rng, draw())
            if candidate is not None:
                return candidate
            self._abandon()
        raise InputError(
            f"family={self.space.family.name}: the car could take none of {ATTEMPTS} roads; widen "
            "the family's radius, or set a smaller length="
        )

    def _uniform(self) -> dict[str, float]:
        return {key: span.at(self.rng.random()) for key, span in self.space.parameters.items()}

    def _family(self) -> dict[str, float]:
        days = {key: span for key, span in self.space.parameters.items() if key in DAYS}
        return {key: span.at(self.rng.random()) for key, span in days.items()}


class ArchiveSampler(Sampler):
    """A sampler that draws from three sources, and most from the one that finds new cells.

    The sources are the family's own roads, parameters drawn uniformly, and changed parameters of
    earlier failures, as in MAP-Elites (Mouret and Clune 2015, "Illuminating search spaces by
    mapping elites", arXiv:1504.04909). Thompson sampling chooses among them, by the share of their
    drives that failed in a new cell. A road is drawn in 10 ms, and driven only if its cell has no
    failure yet, since a drive takes seconds.
    """

    proposals = 30

    def __init__(self, space: SearchSpace, seed: int, archive: Archive) -> None:
        super().__init__(space, seed, archive)
        self.sources = [self._family, self._uniform, self._changed]
        self.hits, self.missed = np.ones(3), np.ones(3)  # drives of each source; new cells, others
        self.failures: list[dict[str, float]] = []

    def learn(self, closeness: Sequence[float]) -> None:
        """Keep failures, and count each source's drives that failed in a new cell."""
        for (source, is_new, candidate), nearness in zip(self.proposed, closeness, strict=True):
            failed = nearness == 1
            (self.hits if failed and is_new else self.missed)[source] += 1
            if failed:
                self.failures.append(candidate.parameters)

    def _choose(self) -> Draw:
        usable = len(self.sources) if self.failures else len(self.sources) - 1
        self.source = int(self.rng.beta(self.hits[:usable], self.missed[:usable]).argmax())
        return self.sources[self.source]

    def _changed(self) -> dict[str, float]:
        """Return changed parameters of a failure."""
        ranges = self.space.parameters
        parent = self.failures[self.rng.integers(len(self.failures))]
        steps = {key: self.rng.normal(0, STEP) for key in ranges}
        return {key: span.at(span.share(parent[key]) + steps[key]) for key, span in ranges.items()}


class OptunaSampler(Sampler):
    """A sampler of Optuna's.

    TPE proposes parameters that resemble those of failures; as in `ArchiveSampler`, only roads in
    cells without a failure are driven. NSGA-II (Deb et al. 2002) evolves a population of roads
    towards failure and novelty, as AmbieGen does (Humeniuk, Khomh and Antoniol 2022, "A
    search-based framework for automatic generation of testing environments for cyber-physical
    systems", doi:10.1016/j.infsof.2022.106936), which evaluates its roads on a model of the car.

    Args:
        name: `tpe` or `nsga2`.
        space: roads and days.
        seed: random seed.
        archive: cells of the search, which the caller keeps up to date.
        startup: number of TPE's first drives, which are at random.

    Raises:
        InputError: Optuna is not installed.
    """

    def __init__(
        self, name: str, space: SearchSpace, seed: int, archive: Archive, startup: int
    ) -> None:
        remedy = 'pip install "drivezoo[optuna]", or use sampler=random'
        with optional_import(f"sampler={name}: Optuna is not installed; {remedy}"):
            import optuna
        super().__init__(space, seed, archive)
        self.ranges: dict[str, optuna.distributions.BaseDistribution] = {
            key: optuna.distributions.FloatDistribution(span.low, span.high, log=span.log)
            for key, span in space.parameters.items()
        }
        self.abandoned = optuna.trial.TrialState.FAIL
        self.driven: list[dict[str, float]] | None = [] if name == "nsga2" else None
        optuna.logging.set_verbosity(optuna.logging.ERROR)
        if name == "nsga2":
            nsga2 = optuna.samplers.NSGAIISampler(population_size=BATCH, seed=seed)
            self.study = optuna.create_study(directions=["maximize"] * 2, sampler=nsga2)
            return
        self.proposals = 8
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)  # multivariate
            tpe = optuna.samplers.TPESampler(seed=seed, n_startup_trials=startup, multivariate=True)
        self.study = optuna.create_study(direction="maximize", sampler=tpe)

    def learn(self, closeness: Sequence[float]) -> None:
        """Take the closeness to failure of the proposed roads' drives, and how new they are."""
        for (trial, _, candidate), nearness in zip(self.proposed, closeness, strict=True):
            values = [nearness]
            if self.driven is not None:
                near = (feature_distance(candidate.features, f, self.space) for f in self.driven)
                values.append(min(near, default=1.0))
                self.driven.append(candidate.features)
            self.study.tell(trial, values)

    def _choose(self) -> Draw:
        return self._ask

    def _ask(self) -> dict[str, float]:
        self.source = self.study.ask(self.ranges)
        return self.source.params

    def _abandon(self) -> None:
        self.study.tell(self.source, state=self.abandoned)


def make_sampler(options: SearchOptions, space: SearchSpace, archive: Archive) -> Sampler:
    """Return the sampler that the options name."""
    if options.sampler == "archive":
        return ArchiveSampler(space, options.seed, archive)
    if options.sampler in ("tpe", "nsga2"):
        startup = max(BATCH, int(STARTUP * options.budget))
        return OptunaSampler(options.sampler, space, options.seed, archive, startup)
    return Sampler(space, options.seed, archive, whole_family=options.sampler == "family")

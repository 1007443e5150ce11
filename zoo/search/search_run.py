"""A search: choose roads, drive them, and keep which failed."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from simulator.track import Track
from zoo.base.process_pool import Pool
from zoo.drives.drive_record import Drive
from zoo.search.failure_map import Archive
from zoo.search.sampler import ArchiveSampler, Sampler, TpeSampler
from zoo.search.search_options import SearchOptions
from zoo.search.search_space import Candidate, SearchSpace
from zoo.worlds.run_drives import all_drives
from zoo.worlds.scenario import Scenario

BATCH = 8  # drives that are chosen together, for every number of processes
STARTUP = 0.12  # share of the budget that TPE draws at random first
USUAL_ROADS = 25  # of the family, for the usual values of features


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
        edge = track.width_at(drive.distance_m) / 2
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
            road=one.content,
            weather=one.weather,
            speed=options.speed,
            frame_rate=options.frame_rate,
            delay_s=options.delay_s,
            quality=options.quality,
        )
        for one in chosen
    ]
    drives = all_drives(checkpoint, scenarios, first_only=True, pool=pool)
    return [Outcome.of(drive, one.track) for drive, one in zip(drives, chosen, strict=True)]


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
    found: list[Driven] = []
    while len(found) < options.budget:
        chosen = sampler.propose(min(BATCH, options.budget - len(found)))
        outcomes = drive(chosen)
        for candidate, outcome in zip(chosen, outcomes, strict=True):
            archive.add(candidate.features, outcome.failed)
            found.append(Driven(candidate, outcome))
        sampler.learn([one.closeness for one in outcomes])
        report(found)
    return found


def make_sampler(options: SearchOptions, space: SearchSpace, archive: Archive) -> Sampler:
    """Return the sampler that the options name."""
    if options.sampler == "archive":
        return ArchiveSampler(space, options.seed, archive)
    if options.sampler == "tpe":
        startup = max(BATCH, int(STARTUP * options.budget))
        return TpeSampler(space, options.seed, archive, startup)
    return Sampler(space, options.seed, archive, whole_family=options.sampler == "family")


def usual_features(space: SearchSpace) -> dict[str, float]:
    """Return each feature's median over 25 roads as the family draws them, on a clear day."""
    rng = np.random.default_rng(0)
    roads = [space.draw(rng, {}) for _ in range(USUAL_ROADS)]
    found = [one.features for one in roads if one is not None]
    return {key: float(np.median([one[key] for one in found])) for key in space.features}


def distance_to_usual(
    features: dict[str, float], usual: dict[str, float], space: SearchSpace
) -> float:
    """Return how far a road is from the family's usual one, 0 (the same)..1; smaller is milder.

    It is the root mean square, over all features, of the difference from the usual value as a share
    of the feature's range.
    """
    scales = {key: one.scale for key, one in space.features.items()}
    steps = [scales[key].share(features[key]) - scales[key].share(usual[key]) for key in scales]
    return float(np.sqrt(np.mean(np.square(steps))))

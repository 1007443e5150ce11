"""A search: choose roads, drive them, and keep which failed."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from zoo.search.failure_archive import Archive
from zoo.search.first_failure import BATCH, DriveJobs, Job, Outcome
from zoo.search.sampler import ArchiveSampler, RandomSampler, TpeSampler
from zoo.search.search_options import SearchOptions
from zoo.search.search_space import Candidate, SearchSpace

STARTUP = 0.12  # share of the budget that TPE draws at random first
USUAL_ROADS = 25  # of the family, for the usual values of features


@dataclass(frozen=True)
class Driven:
    """A road that was driven, and how the drive ended."""

    candidate: Candidate
    outcome: Outcome


def search(
    checkpoint: str,
    options: SearchOptions,
    space: SearchSpace,
    archive: Archive,
    drive: DriveJobs,
    report: Callable[[list[Driven]], None],
) -> list[Driven]:
    """Drive `options.budget` roads and return them in the order of their choice.

    The roads are chosen in batches of 8, whose drives may run in parallel. Therefore the search is
    the same for every number of processes.

    Args:
        checkpoint: checkpoint file.
        options: options of the search.
        space: roads and days to choose from.
        archive: empty cells, which are filled.
        drive: see `opened_drivers`.
        report: function called after each batch with all drives so far.
    """
    sampler = make_sampler(options, space, archive)
    found: list[Driven] = []
    while len(found) < options.budget:
        chosen = sampler.propose(min(BATCH, options.budget - len(found)))
        outcomes = drive([job_of(checkpoint, options, one) for one in chosen])
        for candidate, outcome in zip(chosen, outcomes, strict=True):
            archive.add(candidate.features, outcome.failed)
            found.append(Driven(candidate, outcome))
        sampler.learn([one.closeness for one in outcomes])
        report(found)
    return found


def make_sampler(
    options: SearchOptions, space: SearchSpace, archive: Archive
) -> ArchiveSampler | RandomSampler | TpeSampler:
    """Return the sampler that the options name."""
    if options.sampler == "archive":
        return ArchiveSampler(space, options.seed, archive)
    if options.sampler == "tpe":
        startup = max(BATCH, int(STARTUP * options.budget))
        return TpeSampler(space, options.seed, archive, startup)
    return RandomSampler(space, options.seed, whole_family=options.sampler == "family")


def job_of(checkpoint: str, options: SearchOptions, one: Candidate) -> Job:
    """Return the drive of a road on its day."""
    return Job(
        checkpoint,
        one.content,
        one.weather,
        options.speed,
        options.frame_rate,
        options.delay_s,
        options.quality,
    )


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

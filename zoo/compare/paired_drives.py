"""The drives of two results, paired by road and conditions."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from datamodules.errors import InputError
from zoo.benchmark.result import BenchmarkResult, DriveRecord, read_result

MOST_DRIVES = 5000  # of a result; a bootstrap of them takes 400 MB
# Smallest and greatest possible value of each compared figure.
LIMITS = {"autonomy": (0.0, 1.0), "cte_mean_m": (0.0, 1e6)}


class Road(NamedTuple):
    """A drive of the suite: its group, track, and settings as JSON."""

    group: str
    track: str
    settings: str


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
    a, b = _read_entry(first), _read_entry(second)
    if a.result.suite != b.result.suite:
        raise InputError(
            f"{b.path}: suite: is {b.result.suite}, but {a.path} has {a.result.suite}; "
            "compare results of one suite"
        )
    if a.result.roads != b.result.roads:
        raise InputError(
            f"{b.path}: roads: are {b.result.roads}, but {a.path} has {a.result.roads}: the "
            "suite's roads were drawn differently; run both benchmarks with the same drivezoo"
        )
    for one, other in ((a, b), (b, a)):
        for road in one.drives:
            if road not in other.drives:
                raise InputError(
                    f"{other.path}: drives: has no {_shown(road)}, which {one.path} has; "
                    "run the benchmark again"
                )
    return a, b


def _read_entry(path: Path) -> Entry:
    result = read_result(path)
    if len(result.drives) > MOST_DRIVES:
        raise InputError(
            f"{path}: drives: has {len(result.drives):,}, more than {MOST_DRIVES:,}; "
            "benchmark a smaller suite"
        )
    drives: dict[Road, dict[int, DriveRecord]] = {}
    for number, one in enumerate(result.drives):
        for figure, (smallest, greatest) in LIMITS.items():
            if not smallest <= (value := one.figures[figure]) <= greatest:
                raise InputError(
                    f"{path}: drives.{number}.figures.{figure}: is {value:g}, should be "
                    f"{smallest:g}..{greatest:g}; run the benchmark again"
                )
        road = Road(one.group, one.track, json.dumps(one.settings, sort_keys=True))
        by_seed = drives.setdefault(road, {})
        if one.checkpoint in by_seed:
            raise InputError(
                f"{path}: drives: checkpoint {one.checkpoint} has {_shown(road)} twice; "
                "run the benchmark again"
            )
        by_seed[one.checkpoint] = one
    numbers = range(len(result.checkpoints))
    for road, by_seed in drives.items():
        for number in numbers:
            if number not in by_seed:
                raise InputError(
                    f"{path}: drives: checkpoint {number} has no {_shown(road)}; "
                    "run the benchmark again"
                )
    ordered = {road: [by_seed[one] for one in numbers] for road, by_seed in drives.items()}
    return Entry(path, result, ordered)


def _shown(road: Road) -> str:
    settings = f" with {road.settings}" if road.settings != "{}" else ""
    return f"drive of {road.track}{settings} in group {road.group}"

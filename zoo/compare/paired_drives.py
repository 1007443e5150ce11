"""The drives of two results, paired by road and conditions."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from zoo.base.errors import InputError
from zoo.benchmark.checked_result import Road, read_result, roads_of, shown
from zoo.benchmark.result import BenchmarkResult, DriveRecord


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
                    f"{other.path}: drives: has no {shown(road)}, which {one.path} has; "
                    "run the benchmark again"
                )
    return a, b


def _read_entry(path: Path) -> Entry:
    result = read_result(path)
    return Entry(path, result, roads_of(result))

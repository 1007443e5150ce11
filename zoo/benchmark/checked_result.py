"""The only reader of `result.json`: what can be checked without driving is checked here."""

import math
from pathlib import Path

from zoo.base.bounded_files import check_version, read_json
from zoo.base.errors import InputError
from zoo.base.limits import check_most
from zoo.benchmark.drivers import check_distinct
from zoo.benchmark.result import (
    NAME,
    NEEDED,
    VERSION,
    BenchmarkResult,
    DriveRecord,
    code_name,
    digest_of_drives,
)
from zoo.benchmark.suite import LIKE, Road, Suite, find_suite, read_suite, road_of, suite_names
from zoo.benchmark.summary import Summary, summarize_drives
from zoo.runs.record_fields import check_fields

TOLERANCE = 1e-6  # of figures: other versions of NumPy sum in another order
_AGAIN = "run the benchmark again"


def read_result(path: Path) -> BenchmarkResult:
    """Return a result whose figures and digest are those of its drives.

    Args:
        path: file, or folder that contains `result.json`.

    Raises:
        InputError: the file cannot be read, has another version, or a field is wrong; a drive is
            missing or stands twice; or a figure or digest is not that of the drives.
    """
    path = Path(path)
    path = path / NAME if path.is_dir() else path
    if not path.exists():
        raise InputError(f"{path}: no such file; drivezoo benchmark CKPT out=FOLDER writes one")
    found = read_json(path)
    if isinstance(found, dict):
        remedy = "use the drivezoo that wrote it, or run it again"
        check_version(found.get("version"), VERSION, path, remedy)
        for key in ("drives", "checkpoints"):
            if isinstance(many := found.get(key), list):
                check_most(key, len(many), path, "benchmark a smaller suite, or fewer checkpoints")
    result = check_fields(BenchmarkResult, found, path)
    _check_drives(result, path)
    check_distinct(result.checkpoints, f"{path}: checkpoints: ")
    _check_sums(result, path)
    _check_included_suite(result, path)
    return result


def roads_of(result: BenchmarkResult) -> dict[Road, list[DriveRecord]]:
    """Return the drives of each road, one for each checkpoint in turn."""
    drives: dict[Road, list[DriveRecord]] = {}
    for drive in sorted(result.drives, key=lambda drive: drive.checkpoint):
        drives.setdefault(road_of(drive), []).append(drive)
    return drives


def shown(road: Road) -> str:
    """Return a road as text, for messages."""
    settings = f" with {road.settings:.200}" if road.settings != "{}" else ""
    return f"drive of {road.track:.100}{settings} in group {road.group:.100}"


def check_suite(result: BenchmarkResult, suite: Suite, path: Path) -> None:
    """Check that a result has every drive of the suite, on the same roads.

    Raises:
        InputError: the roads' contents differ, or a drive is missing or not in the suite.
    """
    if result.roads != suite.roads:
        raise InputError(
            f"{path}: roads: digest {result.roads:.40} is not that of the suite {suite.name} here "
            f"({suite.roads}); use the drivezoo that drove it ({code_name(result.code)})"
        )
    wanted = {drive.key for drive in suite.drives}
    if odd := sorted(wanted ^ set(roads_of(result))):
        raise InputError(
            f"{path}: drives: a {shown(odd[0])} is missing, or is not in the suite {suite.name}; "
            f"{_AGAIN}"
        )


def _check_included_suite(result: BenchmarkResult, path: Path) -> None:
    try:
        suite = find_suite(result.suite, suite_names()[0])
    except InputError:  # a user's own suite, which `verify` takes as a key
        return
    check_suite(result, read_suite(*suite), path)


def is_close(first: float | None, second: float | None) -> bool:
    """Return whether two figures are equal but for the order of a sum."""
    return math.isclose(first or 0.0, second or 0.0, rel_tol=TOLERANCE, abs_tol=TOLERANCE)


def _check_drives(result: BenchmarkResult, path: Path) -> None:
    """Check the figures, and that each checkpoint drove every road and clean partner once."""
    if not result.drives:
        raise InputError(f"{path}: drives: has none; {_AGAIN}")
    for number, drive in enumerate(result.drives):
        place, count = f"{path}: drives.{number}", len(result.checkpoints)
        if drive.checkpoint >= count:
            raise InputError(f"{place}.checkpoint: is {drive.checkpoint}, of {count} from 0 on")
        for name, (low, high) in NEEDED.items():
            value = drive.figures.get(name)
            if value is None:
                raise InputError(f"{place}.figures.{name}: is missing; {_AGAIN}")
            if not low <= value <= high:
                bounds = f"must be in {low:g}..{high:g}"
                raise InputError(f"{place}.figures.{name}: is {value:g}, {bounds}")
    roads = roads_of(result)
    clean = {road.track for road in roads if road.group == LIKE}
    for road, drives in roads.items():
        if [drive.checkpoint for drive in drives] != [*range(len(result.checkpoints))]:
            what = f"{shown(road)}: each checkpoint must have it once"
        elif road.settings != "{}" and road.track not in clean:
            what = f"{shown(road)} has no partner in group {LIKE}"
        else:
            continue
        raise InputError(f"{path}: drives: {what}; {_AGAIN}")


def _check_sums(result: BenchmarkResult, path: Path) -> None:
    """Check that the digest and the figures are those of the result's own drives."""
    if result.digest != digest_of_drives(result.drives):
        raise InputError(f"{path}: digest: is not that of its drives; the file was changed")
    given = Summary(result.groups, result.differences, result.headline).flat()
    for name, own in summarize_drives(result.drives).flat().items():
        one = given.get(name)
        if one is None or not all(
            is_close(getattr(one, key), getattr(own, key)) for key in ("value", "low", "high")
        ):
            raise InputError(f"{path}: {name}: is not that of its drives; the file was changed")

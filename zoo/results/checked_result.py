"""The only reader of `result.json`, and `verify`, which repeats some of its drives."""

import functools
import math
import random
from collections.abc import Sequence
from pathlib import Path, PureWindowsPath

from rich.console import Console

from zoo.base.bounded_files import hash_file
from zoo.base.errors import InputError
from zoo.base.limits import check_most
from zoo.base.plain_files import check_version, read_json
from zoo.base.terminal import counted, printable
from zoo.checkpoints.checkpoint_path import find_checkpoint, on_server
from zoo.driving.drives_table import tied_line
from zoo.results.benchmark_options import HUMAN, NO_CHECKPOINT
from zoo.results.result import (
    ANALYSIS,
    DIGESTS,
    LEVEL_NEEDED,
    NEEDED,
    VERSION,
    BenchmarkResult,
    Driver,
    DriveRecord,
    check_distinct,
    code_name,
    digest_of_drives,
    result_path,
)
from zoo.results.suite import LIKE, Road, Suite, find_suite, read_suite, road_of, suite_names
from zoo.results.summary import Summary, summarize_drives
from zoo.runs.code_fingerprint import code_fingerprint
from zoo.runs.record_fields import check_fields

TOLERANCE = 1e-6  # of figures: other versions of NumPy sum in another order
_AGAIN = "run the benchmark again"


def read_result(path: Path) -> BenchmarkResult:
    """Return a result whose figures and digest are those of its drives.

    The figures of an older analysis are computed again from the drives, which are the same.

    Args:
        path: file, or folder that contains `result.json`.

    Raises:
        InputError: the file cannot be read, has another version, or a field is wrong; a drive is
            missing or stands twice; or a figure or digest is not that of the drives.
    """
    path = result_path(Path(path))
    content = read_json(path)
    if isinstance(content, dict):
        remedy = "use the drivezoo that wrote it, or run it again"
        check_version(content.get("version"), VERSION, path, remedy)
        for key in ("drives", "checkpoints"):
            if isinstance(many := content.get(key), list):
                check_most(key, len(many), path, "benchmark a smaller suite, or fewer checkpoints")
    result = check_fields(BenchmarkResult, content, path)
    _check_drives(result, path)
    if result.analysis < ANALYSIS:
        figures = vars(summarize_drives(result.drives))
        result = result.model_copy(update={"analysis": ANALYSIS, **figures})
    check_distinct(result.checkpoints, f"{path}: checkpoints: ")
    _check_sums(result, path)
    return _of_included_suite(result, path)


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
        InputError: the roads' contents or the usual settings differ, or a drive is missing or not
            in the suite.
    """
    for key in ("roads", "usual"):
        driven, here = getattr(result, key), getattr(suite, key)
        if driven and driven != here:
            raise InputError(
                f"{path}: {key}: {driven!s:.200} is not that of the suite {suite.name} here "
                f"({here}); use suite and drivezoo that drove it ({code_name(result.code)})"
            )
    if odd := sorted({drive.key for drive in suite.drives} ^ set(roads_of(result))):
        raise InputError(
            f"{path}: drives: a {shown(odd[0])} is missing, or is not in the suite {suite.name}; "
            f"{_AGAIN}"
        )


def _of_included_suite(result: BenchmarkResult, path: Path) -> BenchmarkResult:
    """Return a result with what is usual in its suite, which older ones lack, if included."""
    try:
        named = find_suite(result.suite, suite_names()[0])
    except InputError:  # a user's own suite, which `verify` takes as a key
        return result
    check_suite(result, suite := _included_suite(*named), path)
    return result.model_copy(update={"usual": suite.usual})


_included_suite = functools.cache(read_suite)  # 240 drives take a second to check


def is_close(first: float | None, second: float | None) -> bool:
    """Return whether two figures are equal but for the order of a sum."""
    return math.isclose(first or 0.0, second or 0.0, rel_tol=TOLERANCE, abs_tol=TOLERANCE)


def _check_drives(result: BenchmarkResult, path: Path) -> None:
    """Check the figures, and that each checkpoint drove every road and clean partner once."""
    if not result.drives:
        raise InputError(f"{path}: drives: has none; {_AGAIN}")
    for number, drive in enumerate(result.drives):
        where, count = f"{path}: drives.{number}", len(result.checkpoints)
        if drive.checkpoint >= count:
            raise InputError(f"{where}.checkpoint: is {drive.checkpoint}, of {count} from 0 on")
        for name, (low, high) in (NEEDED | (LEVEL_NEEDED if drive.level else {})).items():
            value = drive.figures.get(name)
            if value is None:
                raise InputError(f"{where}.figures.{name}: is missing; {_AGAIN}")
            if not low <= value <= high:
                raise InputError(f"{where}.figures.{name}: is {value:g}, not in {low:g}..{high:g}")
    roads = roads_of(result)
    clean = {road.track for road in roads if road.group == LIKE}
    for road, drives in roads.items():
        if [drive.checkpoint for drive in drives] != [*range(len(result.checkpoints))]:
            what = f"{shown(road)}: each checkpoint must have it once"
        elif road.settings != "{}" and road.track not in clean and not drives[0].level:
            what = f"{shown(road)} has no partner in group {LIKE}"
        else:
            continue
        raise InputError(f"{path}: drives: {what}; {_AGAIN}")


def _check_sums(result: BenchmarkResult, path: Path) -> None:
    """Check that the digest and the figures are those of the result's own drives."""
    if result.digest != digest_of_drives(result.drives):
        raise InputError(f"{path}: digest: is not that of its drives; the file was changed")
    stored = Summary(result.groups, result.differences).flat()
    for name, figure in summarize_drives(result.drives).flat().items():
        saved = stored.get(name)
        if saved is None or not all(
            is_close(getattr(saved, key), getattr(figure, key)) for key in ("value", "low", "high")
        ):
            raise InputError(f"{path}: {name}: is not that of its drives; the file was changed")


def verify(path: Path, suite: str, drives: int, workers: int, console: Console) -> None:
    """Check a result, drive some of its drives again, and compare their digests.

    Args:
        path: result.json, or its folder.
        suite: name or path of a suite, for a result of a suite that is not included.
        drives: number of drives to repeat, chosen by the digest; 0 repeats all.
        workers: number of processes; 0 for one per core.
        console: console that shows progress and differences.

    Raises:
        InputError: the result, its suite or a checkpoint cannot be used or does not fit; or a
            digest differs, after the figures of both drives are printed.
    """
    from zoo.results.suite_drives import drive_suite  # imports torch

    result = read_result(path)
    if result.checkpoints[0].file == HUMAN:
        raise InputError(f"{path}: a person drove it: nobody drives twice alike")
    included = read_suite(*find_suite(result.suite, suite))
    check_suite(result, included, path)
    drivers = [_driver(driver, result_path(path).parent, path) for driver in result.checkpoints]
    for line in caveats(result):
        console.print(printable(line), highlight=False, markup=False, soft_wrap=True)
    by_road = {drive.key: drive for drive in included.drives}
    numbers = list(range(len(result.drives)))
    if drives:
        numbers = sorted(random.Random(result.digest).sample(numbers, min(drives, len(numbers))))
    recorded = [result.drives[number] for number in numbers]
    jobs = [(drive.checkpoint, by_road[road_of(drive)]) for drive in recorded]
    driven = drive_suite(drivers, jobs, included.mean_steering, workers, console)
    repeated = f"{len(recorded)} of {counted(len(result.drives), 'drive')} repeated"
    lines = list(filter(None, map(difference_line, recorded, driven)))
    equal = "all digests" if not lines else f"{len(recorded) - len(lines)} digests"
    total = f"{path}: {repeated}: {equal} are equal; {repeated_line(recorded, driven)}"
    for line in [*lines, total]:
        console.print(line, highlight=False, markup=False, soft_wrap=True)
    if lines:
        raise InputError(
            f"{path}: {repeated}: {len(lines)} with another digest or other figures; repeat it "
            f"with the code that drove it ({code_name(result.code)})"
        )


def caveats(result: BenchmarkResult) -> list[str]:
    """Return why the digests of a result may differ here, a line each."""
    here = code_fingerprint()
    other_code = f"the result is of other code ({code_name(result.code)}; here {code_name(here)})"
    reasons = [other_code] if result.code.get("hash") != here["hash"] else []
    if result.digests < DIGESTS and any(driver.sha256 for driver in result.checkpoints):
        reasons.append("the result's networks computed in single precision, now in double")
    if tied := tied_line([driver.model_dump() for driver in result.checkpoints]):
        reasons.append(tied)
    return [f"{reason}: digests may differ" for reason in reasons]


def repeated_line(recorded: Sequence[DriveRecord], driven: Sequence[DriveRecord]) -> str:
    """Return how many drives ended as before, clean or failed, and how far figures are apart."""
    same = sum(old.is_clean == new.is_clean for old, new in zip(recorded, driven, strict=True))
    apart = {
        name: max(
            abs((new.figures[name] or 0) - (old.figures[name] or 0))
            for old, new in zip(recorded, driven, strict=True)
        )
        for name in NEEDED
    }
    figures = ", ".join(f"{name} by {value:.2g}" for name, value in apart.items() if value)
    differ = f"figures differ by at most: {figures}" if figures else "all figures are equal"
    return f"{same} of {len(recorded)} are clean or failed as before; {differ}"


def difference_line(old: DriveRecord, new: DriveRecord) -> str:
    """Return the figures of a drive that differ, as in the result and as repeated; or nothing."""
    pairs = {name: (old.figures[name], new.figures[name]) for name in NEEDED}
    if old.digest == new.digest and all(is_close(*pair) for pair in pairs.values()):
        return ""
    figures = [
        f"{name} {first:g} -> {second:g} (by {abs(second - first):.2g})"
        for name, (first, second) in pairs.items()
        if first is not None and second is not None and first != second
    ]
    what = "; ".join(figures) or "the figures are equal, rows differ"
    return f"{old.group} {old.track}: digest {old.digest} -> {new.digest}; {what}"


def files_beside(record: Driver, folder: Path) -> list[Path]:
    """Return the files that a driver may have in the result's folder.

    They have the name that the result gives it, or the first digits of its hash.
    """
    named = PureWindowsPath(record.file)  # its separators are those of all systems
    return [folder / named.name, folder / f"{(record.sha256 or '')[:16]}{named.suffix}"]


def _driver(record: Driver, folder: Path, path: Path) -> Driver:
    """Return the driver of a result.

    Its file lies in the result's folder (`files_beside`), or where it was. No other file is read.
    """
    from zoo.results.suite_drives import read_driver

    if record.file in NO_CHECKPOINT and record.sha256 is None:
        return record
    beside = files_beside(record, folder)
    files = (path for path in beside if path.is_file() and hash_file(path) == record.sha256)
    named = beside[0] if on_server(record.file) else record.file
    file = next(files, None) or find_checkpoint(named)
    if (digest := hash_file(file)) != record.sha256:
        raise InputError(
            f"{path}: checkpoints: {file} is another file than the one that drove (SHA-256 "
            f"{digest[:16]} instead of {beside[1].stem}); put the right one into {folder}, named "
            f"{beside[0].name} or {beside[1].name}"
        )
    driver = read_driver(file)
    for name, value in driver.model_dump().items():
        if name not in ("file", "tied") and getattr(record, name) != value:
            raise InputError(
                f"{path}: checkpoints: {name}: is {getattr(record, name)}, but {file} has {value}; "
                "the file was changed"
            )
    return driver

"""Verification of a `result.json`: its figures fit its drives, and some drives are repeated."""

import math
import random
from dataclasses import asdict
from pathlib import Path

from rich.console import Console

from datamodules.errors import InputError
from datamodules.terminal import printable
from zoo.benchmark.baselines import BASELINES
from zoo.benchmark.drivers import Driver, check_distinct, file_hash, read_driver
from zoo.benchmark.drives import digest_of_drives, drive_jobs
from zoo.benchmark.result import (
    NEEDED,
    BenchmarkResult,
    DriveRecord,
    DriverRecord,
    read_result,
)
from zoo.benchmark.suite import Suite, drive_key, find_suite, read_suite
from zoo.benchmark.summary import Summary, summarize_drives
from zoo.checkpoints.checkpoint_path import find_checkpoint
from zoo.runs.code_fingerprint import code_fingerprint

TOLERANCE = 1e-6  # of figures: other versions of NumPy sum in another order


def verify(path: Path, suite: str, drives: int, workers: int, console: Console) -> None:
    """Check a result, drive some of its drives again, and compare their digests.

    Args:
        path: result.json, or its folder.
        suite: name or path of a suite, for a result of a suite that is not included.
        drives: number of drives to repeat, chosen at random; 0 repeats all.
        workers: number of processes; 0 for one per core.
        console: console that shows progress and differences.

    Raises:
        InputError: the result, its suite or a checkpoint cannot be used or does not fit; or a
            digest differs, after the figures of both drives are printed.
    """
    result = read_result(path)
    found = read_suite(*find_suite(result.suite, suite))
    _check_suite(result, found, path)
    _check_sums(result, path)
    folder = path if path.is_dir() else path.parent
    drivers = [_driver(one, folder, path) for one in result.checkpoints]
    check_distinct(drivers)
    if result.code.get("hash") != code_fingerprint()["hash"]:
        line = (
            f"the result is of other code ({_code(result.code)}; here "
            f"{_code(code_fingerprint())}): digests may differ"
        )
        console.print(printable(line), highlight=False, markup=False, soft_wrap=True)
    by_key = {one.key: one for one in found.drives}
    numbers = range(len(result.drives))
    if drives:
        numbers = sorted(random.sample(numbers, min(drives, len(numbers))))
    recorded = [result.drives[number] for number in numbers]
    jobs = [(one.checkpoint, by_key[_key(one)]) for one in recorded]
    driven = drive_jobs(drivers, jobs, found.mean_steering, workers, console)
    different = [
        (old, new) for old, new in zip(recorded, driven, strict=True) if not is_same(old, new)
    ]
    for old, new in different:
        console.print(difference_line(old, new), highlight=False, markup=False, soft_wrap=True)
    counted = f"{len(recorded)} of {len(result.drives)} drives repeated"
    if different:
        raise InputError(
            f"{path}: {counted}: {len(different)} with another digest or other figures; repeat "
            f"it with the code that drove it ({_code(result.code)}), on the same kind of machine"
        )
    line = f"{path}: {counted}: all digests are equal"
    console.print(line, highlight=False, markup=False, soft_wrap=True)


def is_same(old: DriveRecord, new: DriveRecord) -> bool:
    """Return whether digest and figures of two drives are equal."""
    return old.digest == new.digest and all(
        _is_close(old.figures[name], new.figures[name]) for name in NEEDED
    )


def difference_line(old: DriveRecord, new: DriveRecord) -> str:
    """Return the figures of a drive that differ, as in the result and as repeated."""
    figures = [
        f"{name} {old.figures[name]:g} -> {new.figures[name]:g} "
        f"(by {abs(new.figures[name] - old.figures[name]):.2g})"
        for name in NEEDED
        if old.figures[name] != new.figures[name]
    ]
    what = "; ".join(figures) or "the figures are equal, rows differ"
    return f"{old.group} {old.track}: digest {old.digest} -> {new.digest}; {what}"


def _check_suite(result: BenchmarkResult, suite: Suite, path: Path) -> None:
    """Check that the result has every drive of the suite, on the same roads."""
    if result.roads != suite.roads:
        raise InputError(
            f"{path}: roads: digest {result.roads} is not that of the suite {suite.name} here "
            f"({suite.roads}); use the drivezoo that drove it ({_code(result.code)})"
        )
    wanted = [one.key for one in suite.drives]
    for number, _ in enumerate(result.checkpoints):
        keys = [_key(one) for one in result.of_checkpoint(number)]
        if sorted(keys) != sorted(wanted):
            odd = sorted(set(keys) ^ set(wanted)) or sorted(keys)
            raise InputError(
                f"{path}: drives: {' '.join(odd[0][:2])} of checkpoint {number} is missing, stands "
                f"twice, or is not in the suite {suite.name}; run the benchmark again"
            )


def _check_sums(result: BenchmarkResult, path: Path) -> None:
    """Check that the digest and the figures are those of the result's own drives."""
    if result.digest != digest_of_drives(result.drives):
        raise InputError(f"{path}: digest: is not that of its drives; the file was changed")
    given = Summary(result.groups, result.differences, result.headline).flat()
    for name, own in summarize_drives(result.drives).flat().items():
        one = given.get(name)
        if one is None or not all(
            _is_close(getattr(one, key), getattr(own, key)) for key in ("value", "low", "high")
        ):
            raise InputError(f"{path}: {name}: is not that of its drives; the file was changed")


def _is_close(first: float | None, second: float | None) -> bool:
    return math.isclose(first or 0.0, second or 0.0, rel_tol=TOLERANCE, abs_tol=TOLERANCE)


def _driver(record: DriverRecord, folder: Path, path: Path) -> Driver:
    """Return the driver of a result; one in the result's folder is found by its hash."""
    if record.file in BASELINES and record.sha256 is None:
        return Driver(**record.model_dump())
    for file in sorted(folder.iterdir()):
        if file.suffix in (".ckpt", ".onnx") and file_hash(file) == record.sha256:
            break
    else:
        file = find_checkpoint(record.file)
    driver = read_driver(file)
    if driver.sha256 != record.sha256:
        raise InputError(
            f"{path}: checkpoints: {file} is another file than the one that drove (SHA-256 "
            f"{(driver.sha256 or '')[:16]} instead of {(record.sha256 or '')[:16]}); put the "
            f"right one into {folder}"
        )
    for name, own in asdict(driver).items():
        if name != "file" and getattr(record, name) != own:
            raise InputError(
                f"{path}: checkpoints: {name}: is {getattr(record, name)}, but {file} has {own}; "
                "the file was changed"
            )
    return driver


def _key(drive: DriveRecord) -> tuple[str, str, str]:
    return drive_key(drive.group, drive.track, drive.settings)


def _code(code: dict[str, str | None]) -> str:
    return code.get("commit") or code.get("hash") or "unknown"

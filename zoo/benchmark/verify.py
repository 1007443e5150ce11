"""Verification of a `result.json`: its figures fit its drives, and some drives are repeated."""

import random
from pathlib import Path, PureWindowsPath

from rich.console import Console

from zoo.base.errors import InputError
from zoo.base.regular_file import hash_file
from zoo.base.terminal import printable
from zoo.benchmark.baselines import BASELINES
from zoo.benchmark.checked_result import check_suite, is_close, read_result
from zoo.benchmark.drivers import read_driver
from zoo.benchmark.drives import drive_suite
from zoo.benchmark.result import NEEDED, Driver, DriveRecord, code_name
from zoo.benchmark.suite import find_suite, read_suite, road_of
from zoo.checkpoints.checkpoint_path import find_checkpoint
from zoo.runs.code_fingerprint import code_fingerprint


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
    check_suite(result, found, path)
    folder = path if path.is_dir() else path.parent
    drivers = [_driver(one, folder, path) for one in result.checkpoints]
    if result.code.get("hash") != code_fingerprint()["hash"]:
        line = (
            f"the result is of other code ({code_name(result.code)}; here "
            f"{code_name(code_fingerprint())}): digests may differ"
        )
        console.print(printable(line), highlight=False, markup=False, soft_wrap=True)
    by_road = {drive.key: drive for drive in found.drives}
    numbers = range(len(result.drives))
    if drives:
        numbers = sorted(random.sample(numbers, min(drives, len(numbers))))
    recorded = [result.drives[number] for number in numbers]
    jobs = [(one.checkpoint, by_road[road_of(one)]) for one in recorded]
    driven = drive_suite(drivers, jobs, found.mean_steering, workers, console)
    counted = f"{len(recorded)} of {len(result.drives)} drives repeated"
    lines = list(filter(None, map(difference_line, recorded, driven)))
    for line in lines or [f"{path}: {counted}: all digests are equal"]:
        console.print(line, highlight=False, markup=False, soft_wrap=True)
    if lines:
        raise InputError(
            f"{path}: {counted}: {len(lines)} with another digest or other figures; repeat it with "
            f"the code that drove it ({code_name(result.code)}), on the same kind of machine"
        )


def difference_line(old: DriveRecord, new: DriveRecord) -> str:
    """Return the figures of a drive that differ, as in the result and as repeated; or nothing."""
    pairs = {name: (old.figures[name], new.figures[name]) for name in NEEDED}
    if old.digest == new.digest and all(is_close(*pair) for pair in pairs.values()):
        return ""
    figures = [
        f"{name} {first:g} -> {second:g} (by {abs(second - first):.2g})"
        for name, (first, second) in pairs.items()
        if first != second
    ]
    what = "; ".join(figures) or "the figures are equal, rows differ"
    return f"{old.group} {old.track}: digest {old.digest} -> {new.digest}; {what}"


def _driver(record: Driver, folder: Path, path: Path) -> Driver:
    """Return the driver of a result.

    Its file has the name that the result gives it, or the first digits of its hash; it lies in the
    result's folder, or where it was. No other file is read.
    """
    if record.file in BASELINES and record.sha256 is None:
        return record
    named = PureWindowsPath(record.file)  # its separators are those of all systems
    digits = (record.sha256 or "")[:16]
    beside = [folder / named.name, folder / f"{digits}{named.suffix}"]
    file = next((one for one in beside if one.is_file() and hash_file(one) == record.sha256), None)
    file = file or find_checkpoint(record.file)
    if (found := hash_file(file)) != record.sha256:
        raise InputError(
            f"{path}: checkpoints: {file} is another file than the one that drove (SHA-256 "
            f"{found[:16]} instead of {digits}); put the right one into {folder}, named "
            f"{beside[0].name} or {beside[1].name}"
        )
    driver = read_driver(file)
    for name, own in driver.model_dump().items():
        if name != "file" and getattr(record, name) != own:
            raise InputError(
                f"{path}: checkpoints: {name}: is {getattr(record, name)}, but {file} has {own}; "
                "the file was changed"
            )
    return driver

"""`sweep.json`: what a sweep was told, so that it can be found again and go on."""

import hashlib
import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from datetime import datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from datamodules.errors import InputError
from datamodules.log_text import MOST_LOG_BYTES
from datamodules.regular_file import read_regular
from zoo.runs.whole_file import write_whole

NAME = "sweep.json"
FORMAT = 1
SWEEPS = Path("outputs/sweeps")
# How a sweep is run is not what it is: another launcher may finish it.
HOW = ("hydra/launcher", "hydra.launcher", "hydra.sweep.", "hydra.verbose")
VERSIONS = ("drivezoo", "torch", "lightning")


@dataclass(frozen=True)
class SweepRecord:
    """What `sweep.json` holds.

    Attributes:
        arguments: as typed, without `-m` and the sweep's folder.
        jobs: the overrides of each job, in the order of their folders' names; None before
            they are known.
        data: of each recording, the digest of its log; None where it was not recorded yet.
        versions: of the packages that decide what comes out.
        started: local time, ISO.
        search: whether Optuna chooses the jobs; `jobs` is None until it has chosen all.
    """

    arguments: list[str]
    jobs: list[list[str]] | None = None
    data: dict[str, str | None] = field(default_factory=dict)
    versions: dict[str, str] = field(default_factory=dict)
    started: str = ""
    search: bool = False


def new_record(arguments: list[str]) -> SweepRecord:
    """Of a sweep that starts now."""
    now = datetime.now().astimezone().isoformat(timespec="seconds")
    return SweepRecord(arguments, versions=package_versions(), started=now)


def write_record(folder: Path, record: SweepRecord) -> None:
    """Replace the file at once; raises OSError where that can't be."""
    write_whole(folder / NAME, json.dumps({"format": FORMAT, **asdict(record)}, indent=1))


def add_to_record(folder: Path, **more: object) -> None:
    """Write again what `sweep.json` holds, with these fields changed."""
    write_record(folder, replace(read_record(folder), **more))


def read_record(folder: Path) -> SweepRecord:
    """What a sweep's folder says of it.

    Raises:
        InputError: no sweep's folder, or one of another version.
    """
    path = folder / NAME
    if not path.exists():
        found = "holds no sweep.json" if folder.is_dir() else "there is no such folder"
        raise InputError(f"{folder}: is no sweep's folder ({found}); see outputs/sweeps")
    from zoo.sweep.sweep_file import read_sweep_file

    try:
        found = read_sweep_file(path)
    except InputError as error:
        raise InputError(f"{error}; it is damaged: start a new sweep") from None
    if found.format != FORMAT:
        raise InputError(f"{path}: was written by another version; use the drivezoo that did")
    return SweepRecord(**{one.name: getattr(found, one.name) for one in fields(SweepRecord)})


def job_folders(folder: Path) -> list[Path]:
    """Of all jobs that have begun, by number."""
    return sorted(
        (path for path in folder.iterdir() if path.name.isdigit() and path.is_dir()),
        key=lambda path: int(path.name),
    )


def varying(jobs: Sequence[Sequence[str]]) -> dict[tuple[str, ...], str]:
    """For each job its overrides that not all the others have.

    >>> varying([("a=1", "b=1"), ("a=2", "b=1")])
    {('a=1', 'b=1'): 'a=1', ('a=2', 'b=1'): 'a=2'}
    """
    shared = set.intersection(*(set(one) for one in jobs)) if len(jobs) > 1 else set()
    return {tuple(one): " ".join(each for each in one if each not in shared) for one in jobs}


def is_same(record: SweepRecord, arguments: list[str]) -> bool:
    """Whether a sweep was told the same, in any order, launcher apart."""
    return _what(record.arguments) == _what(arguments)


def what_changed(record: SweepRecord) -> str | None:
    """Why a sweep that was told the same is another now: its data or our code has changed."""
    for root, digest in record.data.items():
        now = log_digest(root)
        if digest is not None and now is None:
            return f"there is no recording in {root}, seen from here"
        if digest is not None and now != digest:
            return f"the recording in {root} has changed since"
    for name, number in record.versions.items():
        now = package_versions().get(name)
        if now != number:
            return f"{name} was {number} then and is {now} now"
    return None


def log_digest(root: str) -> str | None:
    """16 hex digits of a recording's log; None where there is none to read."""
    path = Path(root)
    path = path / "driving_log.csv" if path.is_dir() else path
    try:
        return hashlib.sha256(read_regular(path, MOST_LOG_BYTES)).hexdigest()[:16]
    except OSError:
        return None


def package_versions() -> dict[str, str]:
    """Of those in `VERSIONS` that are installed."""
    found = {}
    for name in VERSIONS:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def _what(arguments: Iterable[str]) -> list[str]:
    return sorted(one for one in arguments if not one.lstrip("+~").startswith(HOW))

"""`sweep.json`: the record of a sweep's command, by which it is found and resumed."""

import hashlib
import json
from collections.abc import Iterable, Sequence
from datetime import datetime
from importlib.metadata import version
from pathlib import Path

from pydantic import Field

from datamodules.driving_log import MOST_LOG_BYTES
from zoo.base.bounded_files import check_version, read_json
from zoo.base.errors import InputError
from zoo.base.regular_file import read_regular
from zoo.base.whole_file import write_whole
from zoo.runs.record_fields import Fields, Whole, check_fields

NAME = "sweep.json"
FORMAT = 1
SWEEPS = Path("outputs/sweeps")
# Overrides that may change when a sweep is resumed: they do not change what is trained.
LAUNCH_KEYS = ("hydra/launcher", "hydra.launcher", "hydra.sweep.", "hydra.verbose")
VERSIONS = ("drivezoo", "torch", "lightning")


class SweepRecord(Fields):
    """The contents of `sweep.json`.

    Attributes:
        format: version of the file's format.
        arguments: overrides as typed, without `-m` and the sweep's folder.
        jobs: overrides of each job, in the order of their folders' numbers; None until they are
            known.
        data: by recording, the digest of its log; None for a recording that did not exist yet.
        versions: versions of the packages that change results.
        started: local time in ISO format.
        search: whether Optuna chooses the jobs; `jobs` is then None until the last one is chosen.
    """

    format: Whole
    arguments: list[str]
    jobs: list[list[str]] | None = None
    data: dict[str, str | None] = Field(default_factory=dict)
    versions: dict[str, str] = Field(default_factory=dict)
    started: str = ""
    search: bool = False


def new_record(arguments: list[str]) -> SweepRecord:
    """Return the record of a sweep that starts now."""
    now = datetime.now().astimezone().isoformat(timespec="seconds")
    return SweepRecord(format=FORMAT, arguments=arguments, versions=package_versions(), started=now)


def write_record(folder: Path, record: SweepRecord) -> None:
    """Replace `sweep.json` atomically; raises OSError if it cannot be written."""
    write_whole(folder / NAME, json.dumps(record.model_dump(), indent=1))


def add_to_record(folder: Path, **more: object) -> None:
    """Change these fields of `sweep.json`."""
    write_record(folder, read_record(folder).model_copy(update=more))


def read_record(folder: Path) -> SweepRecord:
    """Return the record of a sweep's folder.

    Raises:
        InputError: the folder holds no sweep, a damaged one, or one of another version.
    """
    path = folder / NAME
    if not path.exists():
        found = "holds no sweep.json" if folder.is_dir() else "there is no such folder"
        raise InputError(f"{folder}: is no sweep ({found}); name a folder of {SWEEPS}")
    try:
        record = check_fields(SweepRecord, read_json(path), path)
    except InputError as error:
        raise InputError(f"{error}; the file is damaged, start a new sweep") from None
    check_version(record.format, FORMAT, path)
    return record


def job_folders(folder: Path) -> list[Path]:
    """Return the folders of all jobs that have started, by number."""
    return sorted(
        (path for path in folder.iterdir() if path.name.isdigit() and path.is_dir()),
        key=lambda path: int(path.name),
    )


def varying(jobs: Sequence[Sequence[str]]) -> dict[tuple[str, ...], str]:
    """Return by job the overrides that the jobs do not share, as text.

    >>> varying([("a=1", "b=1"), ("a=2", "b=1")])
    {('a=1', 'b=1'): 'a=1', ('a=2', 'b=1'): 'a=2'}
    """
    shared = set.intersection(*(set(job) for job in jobs)) if len(jobs) > 1 else set()
    return {tuple(job): " ".join(each for each in job if each not in shared) for job in jobs}


def is_same(record: SweepRecord, arguments: list[str]) -> bool:
    """Return whether a sweep has the same overrides, in any order, launcher excluded."""
    return _training_overrides(record.arguments) == _training_overrides(arguments)


def what_changed(record: SweepRecord) -> str | None:
    """Return which recording or package has changed since the sweep began; None if none has."""
    for root, digest in record.data.items():
        now = log_digest(root)
        if digest is not None and now != digest:
            return f"the recording in {root} {'is missing' if now is None else 'has changed since'}"
    now = package_versions()
    for name, number in record.versions.items():
        if now.get(name) != number:
            return f"{name} was {number} and is now {now.get(name)}"
    return None


def log_digest(root: str) -> str | None:
    """Return 16 hex digits of the hash of a recording's log; None if it cannot be read."""
    path = Path(root)
    path = path / "driving_log.csv" if path.is_dir() else path
    try:
        return hashlib.sha256(read_regular(path, MOST_LOG_BYTES)).hexdigest()[:16]
    except OSError:
        return None


def package_versions() -> dict[str, str]:
    """Return the versions of the packages in `VERSIONS`."""
    return {name: version(name) for name in VERSIONS}


def _training_overrides(arguments: Iterable[str]) -> list[str]:
    return sorted(word for word in arguments if not word.lstrip("+~").startswith(LAUNCH_KEYS))

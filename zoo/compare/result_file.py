"""Reader of the fields of `result.json` that a comparison needs."""

from pathlib import Path

from datamodules.errors import InputError
from zoo.runs.bounded_files import read_json
from zoo.runs.record_fields import Count, Fields, Number, Whole, check_fields

NAME = "result.json"
VERSION = 1
NEEDED = ("autonomy", "cte_mean_m")


class DriverRecord(Fields):
    """A checkpoint or a baseline; a baseline has no hash."""

    file: str
    sha256: str | None
    training_seed: Whole | None


class DriveRecord(Fields):
    """A drive: what was driven, and its figures."""

    checkpoint: Count
    group: str
    track: str
    settings: dict[str, object]
    figures: dict[str, Number | None]


class BenchmarkResult(Fields):
    """The contents of `result.json`."""

    suite: str
    roads: str
    code: dict[str, str | None]
    entry: str
    checkpoints: list[DriverRecord]
    drives: list[DriveRecord]


def read_result(path: Path) -> BenchmarkResult:
    """Return a result.

    Args:
        path: file, or folder that contains `result.json`.

    Raises:
        InputError: the file cannot be read, has another version, or a field is wrong.
    """
    path = path / NAME if path.is_dir() else path
    found = read_json(path)
    version = found.get("version") if isinstance(found, dict) else VERSION
    if version != VERSION:
        raise InputError(f"{path}: version: is {version}, not {VERSION}; run the benchmark again")
    result = check_fields(BenchmarkResult, found, path)
    if not result.drives:
        raise InputError(f"{path}: drives: has none; run the benchmark again")
    for number, one in enumerate(result.drives):
        place = f"{path}: drives.{number}"
        if one.checkpoint >= len(result.checkpoints):
            raise InputError(f"{place}.checkpoint: there is no checkpoint {one.checkpoint}")
        for name in NEEDED:
            if one.figures.get(name) is None:
                raise InputError(f"{place}.figures.{name}: is missing; run the benchmark again")
    return result

"""The only writer and reader of `result.json`, the figures of an entry of the benchmark."""

from collections.abc import Sequence
from pathlib import Path

from pydantic import Field

from datamodules.errors import InputError
from zoo.runs.bounded_files import read_json
from zoo.runs.record_fields import Count, Fields, Number, Whole, check_fields
from zoo.runs.whole_file import json_text, write_whole

NAME = "result.json"
VERSION = 1
MOST = 1e6  # metres, seconds or interventions of a drive
NEEDED = {  # figures of every drive, with their smallest and largest value
    "autonomy": (0, 1),
    "interventions": (0, MOST),
    "driven_m": (-MOST, MOST),
    "driven_s": (0, MOST),
    "cte_mean_m": (0, MOST),
    "steering_per_s": (0, MOST),
}


class Interval(Fields):
    """A figure with its 95 % interval; null where there is no value or no bound."""

    value: Number | None
    low: Number | None
    high: Number | None


class DriverRecord(Fields):
    """A checkpoint or a baseline, see `zoo.benchmark.drivers.Driver`."""

    file: str
    sha256: str | None
    model: str
    parameters: Count
    training_seed: Whole | None
    data: str


class DriveRecord(Fields):
    """A drive: what was driven, its figures and the digest of its rows."""

    checkpoint: Count
    group: str
    track: str
    settings: dict[str, object]
    figures: dict[str, Number | None]
    digest: str


class BenchmarkResult(Fields):
    """The contents of `result.json`.

    Attributes:
        version: version of the format.
        suite: name of the suite.
        roads: 16 hexadecimal digits of the contents of the drawn roads.
        code: hash and commit of the code, as in `metrics.json`.
        entry: name of the entry.
        checkpoints: drivers, one for each training seed.
        drives: drives of each checkpoint in turn.
        groups: by group and figure, the figure with its interval.
        differences: by group and figure, the mean difference to the clean partners.
        headline: interquartile mean of the autonomy over all roads but the laps.
        digest: 16 hexadecimal digits of the digests of all drives.
    """

    version: Whole
    suite: str
    roads: str
    code: dict[str, str | None]
    entry: str
    checkpoints: list[DriverRecord]
    drives: list[DriveRecord]
    groups: dict[str, dict[str, Interval]]
    differences: dict[str, dict[str, Interval]] = Field(default_factory=dict)
    headline: Interval
    digest: str

    def of_group(self, group: str) -> list[DriveRecord]:
        """Return the drives of a group."""
        return [one for one in self.drives if one.group == group]

    def of_checkpoint(self, number: int) -> list[DriveRecord]:
        """Return the drives of a checkpoint."""
        return [one for one in self.drives if one.checkpoint == number]


def write_result(folder: Path, result: BenchmarkResult) -> Path:
    """Write `result.json` and return its path."""
    return write_whole(folder / NAME, json_text(result.model_dump()))


def read_result(path: Path) -> BenchmarkResult:
    """Return a result.

    Args:
        path: file, or folder that contains `result.json`.

    Raises:
        InputError: the file cannot be read, has another version, or a field is wrong.
    """
    path = Path(path)
    path = path / NAME if path.is_dir() else path
    if not path.exists():
        raise InputError(
            f"{path}: no such file; name a result of the benchmark: "
            "drivezoo benchmark CKPT out=FOLDER"
        )
    found = read_json(path)
    version = found.get("version") if isinstance(found, dict) else VERSION
    if version != VERSION:
        raise InputError(
            f"{path}: version: is {version}, this drivezoo reads {VERSION}; use the drivezoo that "
            "wrote it, or run the benchmark again"
        )
    result = check_fields(BenchmarkResult, found, path)
    _check_drives(result.drives, len(result.checkpoints), path)
    return result


def _check_drives(drives: Sequence[DriveRecord], checkpoints: int, path: Path) -> None:
    if not drives:
        raise InputError(f"{path}: drives: has none; run the benchmark again")
    for number, one in enumerate(drives):
        place = f"{path}: drives.{number}"
        if one.checkpoint >= checkpoints:
            raise InputError(f"{place}.checkpoint: is {one.checkpoint}, of {checkpoints} from 0 on")
        for name, (low, high) in NEEDED.items():
            value = one.figures.get(name)
            if value is None:
                raise InputError(f"{place}.figures.{name}: is missing; run the benchmark again")
            if not low <= value <= high:
                raise InputError(
                    f"{place}.figures.{name}: is {value:g}, must be in {low:g}..{high:g}"
                )

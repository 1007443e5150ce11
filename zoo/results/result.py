"""The records and the only writer of `result.json`, the figures of an entry of the benchmark."""

import hashlib
import itertools
from collections.abc import Sequence
from pathlib import Path

from pydantic import Field

from zoo.base.bounded_files import MOST_JSON_BYTES, open_binary
from zoo.base.errors import InputError, file_errors
from zoo.base.whole_file import json_text, write_whole
from zoo.runs.code_fingerprint import CodeFacts
from zoo.runs.record_fields import Count, Fields, Number, Whole

NAME = "result.json"
VERSION = 1
DIGESTS = 2  # 1: networks computed in single precision, and differed between processors
ANALYSIS = 2  # 1: other intervals, and an interquartile mean as the headline
MOST = 1e6  # metres, seconds or interventions of a drive
NEEDED = {  # figures of every drive, with their smallest and largest value
    "autonomy": (0, 1),
    "interventions": (0, MOST),
    "driven_m": (-MOST, MOST),
    "driven_s": (0, MOST),
    "cte_mean_m": (0, MOST),
    "steering_per_s": (0, MOST),
}
# What entries are compared by, as it is shown.
SCORES = {"autonomy": "autonomy", "without_intervention": "clean drives"}
LEVEL_NEEDED = {"cte_max_m": (0, MOST)}  # of a drive of a level, too


class Interval(Fields):
    """A figure with its 95 % interval; null where there is no value or no bound."""

    value: Number | None
    low: Number | None
    high: Number | None


class Driver(Fields):
    """A checkpoint or a baseline.

    Attributes:
        file: path of the checkpoint, or name of the baseline.
        sha256: hash of the checkpoint's file; None for a baseline.
        model: class of the network, or name of the baseline.
        parameters: number of parameters.
        training_seed: random seed of the training; None where it is unknown.
        data: fingerprint of the training data; empty where it is unknown.
        tied: why its drives differ on another processor; empty if they do not.
    """

    file: str
    sha256: str | None
    model: str
    parameters: Count
    training_seed: Whole | None
    data: str
    tied: str = ""


class DriveRecord(Fields):
    """A drive: what was driven, its figures and the digest of its rows.

    Attributes:
        level: level of the axis that the group is, from 1 on; 0 for another group.
    """

    checkpoint: Count
    group: str
    track: str
    settings: dict[str, object]
    figures: dict[str, Number | None]
    digest: str
    level: Count = 0

    @property
    def is_clean(self) -> bool:
        """Return whether the drive had no intervention."""
        return not self.figures["interventions"]


class BenchmarkResult(Fields):
    """The contents of `result.json`.

    Attributes:
        version: version of the format.
        suite: name of the suite.
        roads: 16 hexadecimal digits of the contents of the drawn roads.
        code: hash, commit and changed files of the code, as in `metrics.json`.
        entry: name of the entry.
        checkpoints: drivers, one for each training seed.
        drives: drives of each checkpoint in turn.
        analysis: version of the figures that are computed from the drives.
        groups: by group and figure, the figure with its interval; also of all but the laps.
        differences: by group and figure, the mean difference to the clean partners.
        digest: 16 hexadecimal digits of the digests of all drives.
        digests: version of the digests.
        usual: see `Suite`; empty in older results of a user's own suite.
    """

    version: Whole
    suite: str
    roads: str
    code: CodeFacts
    entry: str
    checkpoints: list[Driver]
    drives: list[DriveRecord]
    analysis: Whole = 1
    groups: dict[str, dict[str, Interval]]
    differences: dict[str, dict[str, Interval]] = Field(default_factory=dict)
    digest: str
    digests: Whole = 1
    usual: dict[str, object] = Field(default_factory=dict)

    @property
    def has_levels(self) -> bool:
        """Return whether drives are of axes with levels; all are where the suite has no groups."""
        return any(drive.level for drive in self.drives)

    @property
    def score(self) -> str:
        """Return the figure by which entries are compared.

        It is the autonomy. Drives of levels end at their first intervention: of a suite that has
        such, it is whether drives had none.
        """
        return "without_intervention" if self.has_levels else "autonomy"


def is_result(path: Path) -> bool:
    """Return whether a file or folder has a result of the benchmark, by its name or first keys."""
    path = path / NAME if path.is_dir() else path
    if not path.is_file() or path.name == NAME:
        return path.is_file()
    with file_errors(path), open_binary(path, MOST_JSON_BYTES) as file:
        return b'"suite":' in file.read(200)


def result_path(path: Path) -> Path:
    """Return the file of a result, or of the folder that contains it.

    Raises:
        InputError: there is no such file.
    """
    path = path / NAME if path.is_dir() else path
    if not path.exists():
        raise InputError(
            f"{path}: no such file; drivezoo benchmark CKPT out=FOLDER writes one; the figures of "
            "trainings stand in drivezoo leaderboard FOLDER"
        )
    return path


def write_result(folder: Path, result: BenchmarkResult) -> Path:
    """Write `result.json` and return its path."""
    return write_whole(folder / NAME, json_text(result.model_dump()))


def code_name(code: CodeFacts) -> str:
    """Return commit and hash of the code that drove a result; changed files share a commit."""
    return " ".join(str(code[key]) for key in ("commit", "hash") if code.get(key)) or "unknown"


def check_distinct(drivers: Sequence[Driver], where: str = "") -> None:
    """Raise InputError unless an entry's checkpoints are of different trainings of one network."""
    for earlier, driver in itertools.combinations(drivers, 2):
        if driver.model != earlier.model:
            raise InputError(
                f"{where}{driver.file}: is a {driver.model}, but {earlier.file} is a "
                f"{earlier.model}; the checkpoints of an entry differ only in their seed"
            )
        if driver.sha256 == earlier.sha256:
            raise InputError(f"{where}{driver.file}: is named twice; name each training seed once")
        seed = driver.training_seed
        if seed is not None and (seed, driver.data) == (earlier.training_seed, earlier.data):
            raise InputError(
                f"{where}{driver.file}: has the training seed {seed} and the recordings of "
                f"{earlier.file}; name one checkpoint of each training: intervals are for new "
                "trainings"
            )


def digest_of_drives(drives: Sequence[DriveRecord]) -> str:
    """Return 16 hexadecimal digits of the digests of all drives."""
    return hashlib.sha256("\n".join(drive.digest for drive in drives).encode()).hexdigest()[:16]

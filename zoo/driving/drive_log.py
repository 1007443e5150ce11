"""The files of a drive: `drive.csv`, one row per time step, and `drive.json`, its figures.

Every drive is written in this format: on a socket, in the embedded world, or in the replay of a
recording. All metrics, films and reports read these files. `drive.json` holds the metrics of
`zoo.driving.metrics`; a drive on a socket adds counts of telemetry, counts of interventions by
kind, and percentiles of latency.
"""

import csv
import math
import re
from collections.abc import Iterable
from dataclasses import fields
from functools import lru_cache
from operator import attrgetter
from pathlib import Path
from typing import Any

from pydantic import create_model

from datamodules.driving_log import replace_undecoded
from zoo.base.bounded_files import open_text
from zoo.base.errors import InputError
from zoo.base.plain_files import check_version, read_json
from zoo.base.whole_file import AppendedFile, json_text, write_whole
from zoo.driving.drive_record import Drive, DriveRow, WrittenDrive
from zoo.driving.metrics import METRICS, measure
from zoo.driving.run_drives import Keep
from zoo.runs.record_fields import Fields, Number, Whole, check_fields, plain
from zoo.runs.result_table import known

LOG_NAME, SUMMARY_NAME = "drive.csv", "drive.json"
VERSION = 1  # of drive.json
MOST_BYTES = 256_000_000  # of a drive.csv: days of driving
# Frames lie in the folder. A stranger's could else be files of the user, or \\SERVER\SHARE, where
# Windows would log in.
INSIDE = re.compile(r"(?s)(?!.*\.\.)([^/\\:\0]+/)*[^/\\:\0]*")

COLUMNS = tuple(field.name for field in fields(DriveRow))
_VALUES = attrgetter(*COLUMNS)  # not dataclasses.astuple, which copies each value
_DECIMALS = {"time_s": 4, "latency_ms": 3}


class Known(Fields):
    """Keys of `drive.json` that are not metrics."""

    version: Whole
    drive: str | None = None
    track: str | None = None
    seed: Whole | None = None
    nan_frames: Whole | None = None
    infractions: dict[str, Whole] | None = None
    tied: str | None = None
    checkpoint: str | None = None
    set_mph: Number | None = None
    latency_percentiles_ms: dict[str, Number | None] | None = None


@lru_cache
def summary_fields(metrics: tuple[str, ...]) -> type[Known]:
    """Return the fields of `drive.json`, of which each metric is one."""
    figures: dict[str, Any] = {
        name: ((Whole if METRICS[name].whole else Number) | None, None) for name in metrics
    }
    return create_model("Summary", __base__=Known, **figures)


class DriveWriter(AppendedFile):
    """Writer that appends rows to a folder's `drive.csv`; a row is never written in part.

    Raises:
        InputError: the folder holds a drive already.
        OSError: the folder cannot be written to, or the disk is full.
    """

    def __init__(self, folder: Path) -> None:
        if (folder / LOG_NAME).exists():
            raise InputError(f"{folder}: holds a {LOG_NAME} already; name another folder")
        folder.mkdir(parents=True, exist_ok=True)
        super().__init__(folder / LOG_NAME)
        self.append([COLUMNS])

    def add(self, rows: Iterable[DriveRow]) -> None:
        """Append rows; none is written if the disk is full (OSError)."""
        self.append([_texts(row) for row in rows])


def write_summary(folder: Path, summary: dict) -> None:
    """Write `drive.json`; NaN becomes null."""
    write_whole(folder / SUMMARY_NAME, json_text({"version": VERSION, **summary}))


def read_summary(path: Path) -> dict:
    """Return the contents of a `drive.json`.

    Raises:
        InputError: the file cannot be read, has another version, or a value has the wrong type.
    """
    summary = check_fields(summary_fields(tuple(METRICS)), read_json(path), path)
    check_version(summary.version, VERSION, path)
    return plain(summary)


def summarize(drive: Drive) -> dict:
    """Return a drive's track, seed and metrics; and infractions, ..., if there are some."""
    figures = {"track": drive.track, "seed": drive.seed, **measure(drive)}
    others = {name: getattr(drive, name) for name in ("infractions", "nan_frames", "tied")}
    return figures | {name: value for name, value in others.items() if value}


class KeptFigures(Keep):
    """A drive's figures, see `summarize`; one that is not finite is None."""

    def result(self, drive: Drive, policy: Any, world: Any) -> dict[str, Any]:
        """Return the figures."""
        return {
            key: known(value) if isinstance(value, float) else value
            for key, value in summarize(drive).items()
        }


def write_drive(folder: Path, drive: Drive, **keys: object) -> None:
    """Write `drive.csv` and `drive.json` of a drive that has ended.

    Args:
        folder: folder to write to.
        drive: drive to write.
        **keys: further keys of `drive.json`.

    Raises:
        InputError: the folder holds a drive already.
        OSError: the folder cannot be written to, or the disk is full.
    """
    writer = DriveWriter(folder)
    writer.add(drive.rows)
    writer.close()
    write_summary(folder, {"drive": drive.source, **summarize(drive), **keys})


def read_drive(folder: Path | str) -> WrittenDrive:
    """Read the drive in a folder.

    Raises:
        InputError: the folder holds no drive, or a row is damaged.
    """
    folder = Path(folder)
    path = folder / LOG_NAME
    if not path.exists():
        raise InputError(f"{folder}: holds no {LOG_NAME}; name a folder that drivezoo drive wrote")
    with open_text(path, MOST_BYTES, errors="surrogateescape") as file:
        reader = csv.reader(file)
        try:
            header, *rows = list(reader) or [[]]
        except csv.Error as error:
            reason = f"{path}, row {reader.line_num}: cannot be read ({error}); delete the row"
            raise InputError(reason) from None
    if tuple(header) != COLUMNS:
        raise InputError(f"{path}: its columns are not {','.join(COLUMNS)}; name another folder")
    read = []
    for line, texts in enumerate(rows, 2):
        try:
            if len(texts) != len(COLUMNS):
                raise ValueError(f"{len(texts)} columns, expected {len(COLUMNS)}")
            read.append(DriveRow(*map(_value, COLUMNS, texts)))
        except ValueError as error:
            raise InputError(f"{path}, row {line}: {error}; delete the row") from None
    path = folder / SUMMARY_NAME
    summary = read_summary(path) if path.exists() else {}
    return WrittenDrive.of(
        read,
        folder=folder,
        summary=summary,
        source=summary.get("drive") or "",
        track=summary.get("track") or "",
        seed=summary.get("seed") or 0,
    )


def _texts(row: DriveRow) -> list[str]:
    texts = []
    for name, value in zip(COLUMNS, _VALUES(row), strict=True):
        if isinstance(value, float):
            value = "" if math.isnan(value) else f"{value:.{_DECIMALS.get(name, 5)}f}"
        texts.append(str(int(value) if isinstance(value, bool) else value))
    return texts


def _value(name: str, text: str) -> Any:
    """Return a value of a column; raise ValueError for one that the writer does not write."""
    if name in ("driver", "frame"):
        if not INSIDE.fullmatch(text) or (not text.isascii() and replace_undecoded(text) != text):
            raise ValueError(f"{name} is {text[:40]!a}")
        return text
    try:
        value = math.nan if not text else float(text)
    except ValueError:
        value = math.inf
    whole = {"client": (1, 1e9), "intervention": (0, 1)}.get(name)
    if math.isinf(value) or (whole and not (whole[0] <= value <= whole[1] and value % 1 == 0)):
        raise ValueError(f"{name} is {text[:40]!r}, not a {'whole ' if whole else ''}number")
    return value

"""The record of a drive: `drive.csv`, a row for each time step, and `drive.json`, what it came to.

Every drive is written like this, wherever it took place: a simulator on the socket, the embedded
world, the replay of a recording. All metrics, films and reports read it, and nothing else.
"""

import csv
import io
import json
import math
import os
from collections.abc import Iterable
from dataclasses import astuple, dataclass, fields
from pathlib import Path

import numpy as np

from datamodules.errors import InputError
from datamodules.log_text import printable
from datamodules.regular_file import open_text
from zoo.runs.whole_file import write_whole

LOG_NAME, SUMMARY_NAME = "drive.csv", "drive.json"
MOST_BYTES = 256_000_000  # of a log: days of driving
POLICY, PERSON, FALLBACK = "policy", "person", "fallback"


@dataclass(frozen=True)
class DriveRow:
    """A time step of a drive.

    Attributes:
        time_s: since the drive began.
        client: which simulator it was, 1 is the first that connected.
        driver: `policy`; `person` who overrode it; `fallback`, where something went wrong.
        frame: the picture's path within the drive's folder; empty where it was not recorded.
        steering: that was sent, -1..1.
        throttle: that was sent, -1..1, negative brakes.
        speed_mph: of the car; NaN where it is not known.
        cross_track_m: from the centre line; NaN where it is not known.
        intervention: a person, or the scoring, began to intervene in this step.
        latency_ms: from the frame's arrival to the reply's departure; NaN where there was none.
    """

    time_s: float
    client: int = 1
    driver: str = POLICY
    frame: str = ""
    steering: float = 0.0
    throttle: float = 0.0
    speed_mph: float = math.nan
    cross_track_m: float = math.nan
    intervention: bool = False
    latency_ms: float = math.nan


COLUMNS = tuple(field.name for field in fields(DriveRow))
_DECIMALS = {"time_s": 4, "latency_ms": 3}


@dataclass(frozen=True)
class Drive:
    """A drive as columns, in the order in which it took place.

    Attributes:
        folder: where it was read from; `frame` is relative to it.
        summary: what `drive.json` holds; empty where the drive was cut off.
        time_s, steering, throttle, speed_mph, cross_track_m, latency_ms: float64 [N].
        client: int64 [N].
        driver, frame: str [N].
        intervention: bool [N].
    """

    folder: Path
    summary: dict
    time_s: np.ndarray
    client: np.ndarray
    driver: np.ndarray
    frame: np.ndarray
    steering: np.ndarray
    throttle: np.ndarray
    speed_mph: np.ndarray
    cross_track_m: np.ndarray
    intervention: np.ndarray
    latency_ms: np.ndarray

    def __len__(self) -> int:
        return len(self.time_s)


class DriveWriter:
    """Appends rows to a folder's `drive.csv`, each in whole and at once.

    Raises:
        InputError: the folder holds a drive already.
        OSError: it cannot be written to, or the disk is full.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / LOG_NAME
        if self.path.exists():
            raise InputError(f"{folder} holds a {LOG_NAME} already; name another folder")
        folder.mkdir(parents=True, exist_ok=True)
        self._file = AppendedFile(self.path)
        self._file.append([COLUMNS])

    def add(self, rows: Iterable[DriveRow]) -> None:
        self._file.append([_texts(row) for row in rows])

    def close(self) -> None:
        self._file.close()


class AppendedFile:
    """A CSV file to which lines are added whole or not at all, so that it can be read at any time,
    whatever ends the process or fills the disk."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("xb", buffering=0)

    def append(self, rows: Iterable[Iterable[object]]) -> None:
        """Raises OSError where the disk is full; then nothing of the rows is there."""
        lines = io.StringIO()
        csv.writer(lines, lineterminator="\n").writerows(rows)
        text, written = lines.getvalue().encode(), 0
        size = os.fstat(self._file.fileno()).st_size
        try:
            while written < len(text):  # a disk that is nearly full takes the beginning first
                written += self._file.write(text[written:])
        except OSError:
            self._file.truncate(size)
            self._file.seek(size)
            raise

    def close(self) -> None:
        self._file.close()


def write_summary(folder: Path, summary: dict) -> None:
    """Write `drive.json`; NaN becomes null, which JSON has instead."""
    write_whole(folder / SUMMARY_NAME, json.dumps(_without_nan(summary), indent=2) + "\n")


def read_drive(folder: Path | str) -> Drive:
    """The drive in a folder.

    Raises:
        InputError: there is none, or a row is damaged.
    """
    folder = Path(folder)
    path = folder / LOG_NAME
    if not path.exists():
        raise InputError(f"{folder}: holds no {LOG_NAME}; python -m zoo.drive leaves one")
    header, *rows = _rows(path) or [[]]
    if tuple(header) != COLUMNS:
        raise InputError(f"{path}: its columns are not {','.join(COLUMNS)}; is it a drive's?")
    columns: dict[str, list[object]] = {name: [] for name in COLUMNS}
    for line, row in enumerate(rows, 2):
        if len(row) != len(COLUMNS):
            raise InputError(f"{path}, row {line}: {len(row)} columns, expected {len(COLUMNS)}")
        for name, text in zip(COLUMNS, row, strict=True):
            columns[name].append(_value(path, line, name, text))
    from zoo.drives.drive_file import read_summary_file

    summary = folder / SUMMARY_NAME
    types = {"client": np.int64, "driver": np.str_, "frame": np.str_, "intervention": np.bool_}
    return Drive(
        folder,
        read_summary_file(summary) if summary.exists() else {},
        **{name: np.array(columns[name], types.get(name, np.float64)) for name in COLUMNS},
    )


def _rows(path: Path) -> list[list[str]]:
    with open_text(path, MOST_BYTES, errors="surrogateescape") as file:
        reader = csv.reader(file)
        try:
            return list(reader)
        except csv.Error as error:
            said = f"{path}, row {reader.line_num + 1}: cannot be read ({error}); delete the row"
            raise InputError(said) from None


def _texts(row: DriveRow) -> list[str]:
    texts = []
    for name, value in zip(COLUMNS, astuple(row), strict=True):
        if isinstance(value, bool):
            value = int(value)
        elif isinstance(value, float):
            value = "" if math.isnan(value) else f"{value:.{_DECIMALS.get(name, 5)}f}"
        texts.append(str(value))
    return texts


def _value(path: Path, line: int, name: str, text: str) -> object:
    if name in ("driver", "frame"):
        if "\0" in text or (not text.isascii() and printable(text) != text):
            raise InputError(f"{path}, row {line}: {name} is {text[:40]!a}; delete the row")
        return text
    try:
        value = math.nan if not text else float(text)
    except ValueError:
        value = math.inf
    whole = {"client": (1, 1e9), "intervention": (0, 1)}.get(name)
    if math.isinf(value) or (whole and not (whole[0] <= value <= whole[1] and value % 1 == 0)):
        what = "whole number" if whole else "number"
        raise InputError(f"{path}, row {line}: {name} is {text[:40]!r}, not a {what}")
    return value


def _without_nan(value: object) -> object:
    if isinstance(value, dict):
        return {key: _without_nan(one) for key, one in value.items()}
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return value

"""The record of a drive: `drive.csv`, a row for each time step, and `drive.json`, what it came to.

Every drive is written like this, wherever it took place: a simulator on the socket, the embedded
world, the replay of a recording. All metrics, films and reports read it, and nothing else.
"""

import csv
import io
import math
import os
from collections.abc import Iterable
from dataclasses import astuple, fields
from pathlib import Path
from typing import Any

import numpy as np

from datamodules.errors import InputError
from datamodules.log_text import replace_undecoded
from datamodules.regular_file import open_text
from zoo.drives.drive_record import TYPES, Drive, DriveRow
from zoo.drives.metrics import measure
from zoo.runs.whole_file import json_text, write_whole

LOG_NAME, SUMMARY_NAME = "drive.csv", "drive.json"
VERSION = 1  # of drive.json; files of before have none
MOST_BYTES = 256_000_000  # of a log: days of driving


COLUMNS = tuple(field.name for field in fields(DriveRow))
_DECIMALS = {"time_s": 4, "latency_ms": 3}


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
    """Write `drive.json`, see `zoo.drives.drive_file`; NaN becomes null, which JSON has instead."""
    summary = {"version": VERSION, **summary}
    write_whole(folder / SUMMARY_NAME, json_text(summary))


def summarize(drive: Drive) -> dict:
    """Return a drive's track, seed and metrics; `nan_frames` where the policy steered NaN."""
    figures = {"track": drive.track, "seed": drive.seed, **measure(drive)}
    return figures | ({"nan_frames": drive.nan_frames} if drive.nan_frames else {})


def write_drive(folder: Path, drive: Drive, **more: object) -> None:
    """Write a drive that has ended: `drive.csv`, and its figures as `drive.json`.

    Args:
        folder: of the drive.
        drive: rows and what else is known.
        **more: further keys of `drive.json`.

    Raises:
        InputError: the folder holds a drive already.
        OSError: it cannot be written to, or the disk is full.
    """
    writer = DriveWriter(folder)
    writer.add(drive.rows)
    writer.close()
    write_summary(folder, {"drive": drive.source, **summarize(drive), **more})


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

    path = folder / SUMMARY_NAME
    summary = read_summary_file(path) if path.exists() else {}
    arrays: dict[str, Any] = {
        name: np.array(columns[name], TYPES.get(name, np.float64)) for name in COLUMNS
    }
    return Drive(
        **arrays,
        folder=folder,
        summary=summary,
        source=summary.get("drive") or "",
        track=summary.get("track") or "",
        seed=summary.get("seed") or 0,
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
        if "\0" in text or (not text.isascii() and replace_undecoded(text) != text):
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

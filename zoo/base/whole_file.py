"""Replace files in one step, so that they are complete even if the process is killed."""

import json
import math
import os
import re
import secrets
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np

from zoo.base.errors import InputError, file_errors
from zoo.base.file_text import csv_text
from zoo.base.output_files import check_output
from zoo.base.plain_files import mapped

OPEN_FILES_STAY = os.name == "nt"  # Windows replaces no file that a program has open
REPLACE_S, RETRY_S = 2.0, 0.1  # longest wait for it, and time between two tries
PART = re.compile(r"\..+\.[0-9a-f]{16}\.part")  # names of hidden files and folders


def json_text(value: object) -> str:
    r"""Return JSON, with null for NaN and infinity.

    >>> json_text({"a": [float("nan"), 1]})
    '{\n  "a": [\n    null,\n    1\n  ]\n}\n'
    """
    return json.dumps(mapped(_without_nan, value), indent=2, allow_nan=False) + "\n"


def _without_nan(value: object) -> object:
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return value


def write_whole(path: Path, data: str | bytes | memoryview) -> Path:
    """Write a file in one step, see `whole_path`; return the path."""
    contents = data.encode(errors="backslashreplace") if isinstance(data, str) else data
    with whole_path(path) as part, part.open("wb") as file:
        file.write(contents)
        file.flush()
        os.fsync(file.fileno())
    return path


@contextmanager
def whole_path(path: Path) -> Iterator[Path]:
    """Yield a new hidden file next to a file to write to, which then becomes the file.

    Its name is random and must not exist. So no link is followed that another person has put there,
    or in place of the file.

    Raises:
        OSError: the file cannot be written; names the file, and keeps its old contents.
    """
    part = path.with_name(f".{path.name}.{secrets.token_hex(8)}.part")
    try:
        try:
            part.open("xb").close()  # not from `tempfile`: other users could not read its files
            yield part
            move_whole(part, path)
        except BaseException:
            part.unlink(missing_ok=True)
            raise
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error


def move_whole(part: Path, path: Path) -> None:
    """Replace a file, or name a new folder; on Windows, wait until other programs close its files.

    Raises:
        OSError: the path cannot be written; or a program, such as a virus scanner, keeps it open.
    """
    last_s = time.monotonic() + REPLACE_S
    while True:
        try:
            part.replace(path)
            return
        except PermissionError as error:
            is_read_only = path.exists() and not os.access(path, os.W_OK)
            if not OPEN_FILES_STAY or is_read_only or path.is_dir():
                raise
            if time.monotonic() >= last_s:
                reason = "is open in another program; close it there and repeat the command"
                raise OSError(error.errno, reason, str(path)) from error
        time.sleep(RETRY_S)


def write_output(path: Path, data: str | bytes | memoryview, key: str = "out") -> Path:
    """Write a file that the user named in one step, see `whole_path`; return the path.

    Raises:
        UsageError: see `check_output`.
        InputError: the file cannot be written.
    """
    check_output(path, key)
    with file_errors(f"{key}={path}" if key else path):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, data)
    return path


def write_new(path: Path, data: bytes | memoryview) -> None:
    """Write a file that must not exist, without waiting for the disk; remove it after an error.

    Raises:
        OSError: the file exists, or cannot be written.
    """
    file = path.open("xb")
    try:
        with file:
            file.write(data)
    except BaseException:  # now it is closed: Windows removes no open file
        path.unlink(missing_ok=True)
        raise


class AppendedFile:
    """A CSV file that is readable at any time, also after a kill or on a full disk."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("xb", buffering=0)

    def append(self, rows: Iterable[Iterable[object]]) -> None:
        """Append rows, all or none.

        Raises:
            OSError: the disk is full; none of the rows is written.
        """
        text, written = csv_text(rows, exact=True).encode(errors="surrogateescape"), 0
        size = os.fstat(self._file.fileno()).st_size
        try:
            while written < len(text):  # a nearly full disk accepts only the beginning
                written += self._file.write(text[written:])
        except OSError:
            self._file.truncate(size)
            self._file.seek(size)
            raise

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def remove_parts(folder: Path) -> None:
    """Remove the temporary files that killed processes have left in a folder."""
    with suppress(OSError):  # no such folder, or another user's file
        for part in [path for path in folder.iterdir() if PART.fullmatch(path.name)]:
            part.unlink(missing_ok=True)


def refuse_links_out(folder: Path) -> None:
    """Refuse a folder, which may come from another person, with a link that leads out of it.

    Raises:
        InputError: names the link.
    """
    root = os.path.realpath(folder)
    for parent, folders, files in os.walk(folder):
        for name in (*folders, *files):
            if not (path := Path(parent, name)).is_symlink():
                continue
            target = os.path.realpath(path)
            if target != root and not target.startswith(root + os.sep):
                raise InputError(
                    f"{path}: is a link out of {folder} to {target}, which would be overwritten; "
                    "remove the link, or replace it by a copy"
                )

"""Limits on what a file of another person may ask of this computer, in one table.

A reader compares what a file claims with its limit before it reads or allocates that much. The
limits keep each file's reading below five seconds and 500 MB.
"""

import io
import re
import struct
import zipfile
from typing import BinaryIO, TypeGuard

from zoo.base.errors import InputError

MOST = {
    # Of a recording, in any format.
    "rows": 1_000_000,  # 28 hours at ten images a second
    "columns": 1_000,
    # Of JSON, YAML, pickles and marshalled code; a value counts as often as it is reached.
    "values": 1_000_000,
    "levels": 64,
    # Of an archive or container.
    "members": 20_000,
    "bytes of an index": 4_000_000,
    "arrays": 10_000,  # of HDF5
    # Of a suite or of a result of the benchmark.
    "drives": 5_000,  # 20 trainings on v2
    "checkpoints": 100,
}
# Bytes after decompression: a free amount, and so many times the bytes of the file.
FREE_BYTES, MOST_RATIO = 64_000_000, 8
# Largest values that a program may report; a larger one is as if it had reported none.
MOST_MPH, MOST_REPORTED = 200.0, 1e10
_NUMBER = re.compile(r"[+-]?\d{1,12}([.,]\d{1,20})?([eE][+-]?\d{1,3})?")
_END, _END_64 = b"PK\5\6", b"PK\6\6"  # records at an archive's end
_END_BYTES = 22 + 65_535 + 20 + 56  # both records, the comment between, and a locator
LARGEST_32 = 0xFFFFFFFF


def is_ordinary(value: object, least: float = 0.0, most: float = 1e9) -> TypeGuard[float]:
    """Return whether a value is a finite number of ordinary size.

    >>> is_ordinary(127.5), is_ordinary(float("nan")), is_ordinary(10**400), is_ordinary(True)
    (True, False, False, False)

    Args:
        value: value from a file.
        least: smallest absolute value, for a number that others are divided by.
        most: largest absolute value.
    """
    return (
        isinstance(value, int | float) and type(value) is not bool and least <= abs(value) <= most
    )


def parse_number(value: object, most: float = MOST_REPORTED) -> float | None:
    """Return the number in a message's JSON number or text; None if it is none, or too large.

    >>> parse_number("9,2500"), parse_number(9.25), parse_number("1,234.5"), parse_number(1e308)
    (9.25, 9.25, None, None)

    Args:
        value: value from a program; a text may have either decimal sign.
        most: largest absolute value.
    """
    if isinstance(value, str):
        if not _NUMBER.fullmatch(value.strip()):
            return None
        value = float(value.strip().replace(",", "."))
    return float(value) if is_ordinary(value, most=most) else None


def check_most(what: str, count: int, source: object, remedy: str = "name another file") -> None:
    """Check a count that a file claims.

    Args:
        what: key of `MOST`.
        count: number that the file claims or holds.
        source: file, and the key or row in it, for the message.
        remedy: what the user can do about it.

    Raises:
        InputError: the count is above the limit.
    """
    if count > MOST[what]:
        raise InputError(
            f"{source}: has {count:,} {what}, more than the {MOST[what]:,} that are read; {remedy}"
        )


def check_unpacked(unpacked: int, size: int, source: object) -> None:
    """Check the bytes that a compressed file claims to hold.

    Args:
        unpacked: bytes after decompression that the file claims.
        size: bytes of the file.
        source: file, and the part of it, for the message.

    Raises:
        InputError: the file claims far more bytes than it can usually hold.
    """
    most = FREE_BYTES + MOST_RATIO * size
    if unpacked > most:
        raise InputError(
            f"{source}: claims {unpacked:,} bytes after decompression, more than the {most:,} that "
            f"are read of a file of {size:,} bytes; copy it again, or name another file"
        )


def open_archive(file: BinaryIO, source: object) -> zipfile.ZipFile:
    """Open an archive whose members unpack to an ordinary number of bytes.

    Args:
        file: opened file.
        source: file's name, for messages.

    Raises:
        InputError: the archive has too many members, or they claim too many bytes.
        zipfile.BadZipFile: the file is truncated or damaged.
    """
    size = file.seek(0, io.SEEK_END)
    check_most("bytes of an index", _directory_bytes(file, size), source)
    archive = zipfile.ZipFile(file)
    check_most("members", len(archive.infolist()), source)
    check_unpacked(sum(member.file_size for member in archive.infolist()), size, source)
    return archive


def _directory_bytes(file: BinaryIO, size: int) -> int:
    """Return the bytes of an archive's list of members, which `zipfile` reads whole."""
    file.seek(max(0, size - _END_BYTES))
    tail = file.read(_END_BYTES)
    at = tail.rfind(_END)
    if at < 0 or len(tail) < at + 22:
        raise zipfile.BadZipFile("its end is missing")
    (count,) = struct.unpack_from("<L", tail, at + 12)
    at = tail.rfind(_END_64, 0, at)
    if at >= 0 and len(tail) >= at + 48:
        count = max(0 if count == LARGEST_32 else count, *struct.unpack_from("<Q", tail, at + 40))
    return count

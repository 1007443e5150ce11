"""Open zip archives of other people, with limits that are checked before anything is unpacked."""

import io
import struct
import zipfile
from typing import BinaryIO

from zoo.base.limits import check_most, check_unpacked

_END, _END_64 = b"PK\5\6", b"PK\6\6"  # records at an archive's end
_END_BYTES = 22 + 65_535 + 20 + 56  # both records, the comment between, and a locator
LARGEST_32 = 0xFFFFFFFF


def open_archive(file: BinaryIO, place: object) -> zipfile.ZipFile:
    """Open an archive whose members unpack to an ordinary number of bytes.

    Args:
        file: opened file.
        place: file's name, for messages.

    Raises:
        InputError: the archive has too many members, or they claim too many bytes.
        zipfile.BadZipFile: the file is truncated or damaged.
    """
    size = file.seek(0, io.SEEK_END)
    check_most("bytes of an index", _directory_bytes(file, size), place)
    archive = zipfile.ZipFile(file)
    check_most("members", len(archive.infolist()), place)
    check_unpacked(sum(one.file_size for one in archive.infolist()), size, place)
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

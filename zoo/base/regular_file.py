"""Open and read only regular files: refuse a pipe, device or folder without waiting for it.

The kind and the size are checked on the opened descriptor, so that the file cannot be replaced in
between. A symbolic link to a regular file is allowed.
"""

import errno
import hashlib
import io
import os
import stat
from pathlib import Path
from typing import BinaryIO, TextIO

from zoo.base.errors import InputError

MOST_LINE = 1_000_000  # characters of a row of text
MOST_HASHED_BYTES = 8_000_000_000
# O_NONBLOCK: opening a pipe does not wait for its writer. Regular files ignore it.
_FLAGS = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)


def open_regular(path: str | Path, most_bytes: int) -> tuple[int, int]:
    """Return a regular file's descriptor, for reading, and its size.

    Raises:
        OSError: the file is missing, not regular, or above `most_bytes`; `strerror` says why.
    """
    try:
        descriptor = os.open(path, _FLAGS)
    except ValueError as error:  # a NUL in the path
        raise OSError(errno.EINVAL, str(error), ascii(str(path))) from None
    try:
        found = os.fstat(descriptor)
        if not stat.S_ISREG(found.st_mode):
            kind = "is a directory, no" if stat.S_ISDIR(found.st_mode) else "is no"
            raise OSError(errno.EINVAL, f"{kind} regular file", str(path))
        if found.st_size > most_bytes:
            reason = f"has {found.st_size:,} bytes, more than the {most_bytes:,} that are read"
            raise OSError(errno.EFBIG, reason, str(path))
    except BaseException:
        os.close(descriptor)
        raise
    return descriptor, found.st_size


def read_regular(path: str | Path, most_bytes: int) -> bytes:
    """Return a file's bytes, as many as it had when it was opened.

    It raises what `open_regular` raises. It makes few system calls, because threads queue for
    Python's lock after each.
    """
    descriptor, size = open_regular(path, most_bytes)
    try:
        data = os.read(descriptor, size)
        while len(data) < size and (more := os.read(descriptor, size - len(data))):
            data += more
        return data
    finally:
        os.close(descriptor)


def hash_file(path: str | Path) -> str:
    """Return the SHA-256 of a file's contents, read in pieces.

    Raises:
        InputError: the file is missing, not regular or too large.
    """
    digest = hashlib.sha256()
    try:
        with open_binary(path, MOST_HASHED_BYTES) as file:
            while piece := file.read(1 << 20):
                digest.update(piece)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}; name another file") from None
    return digest.hexdigest()


def open_binary(path: str | Path, most_bytes: int) -> BinaryIO:
    """Open a regular file for reading; raises what `open_regular` raises."""
    descriptor, size = open_regular(path, most_bytes)
    if not size:  # the kernel's files, such as /proc/kmsg, may be endless
        os.close(descriptor)
        return io.BytesIO()
    return os.fdopen(descriptor, "rb")


def open_text(path: str | Path, most_bytes: int, errors: str = "strict") -> TextIO:
    """Open a CSV file, UTF-8 with or without a byte order mark; keep its line ends.

    Raises:
        InputError: the file is missing, not regular or too large.
    """
    try:
        file = open_binary(path, most_bytes)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}; name another file") from None
    return _BoundedLines(file, path, errors)


class _BoundedLines(io.TextIOWrapper):
    """A text whose iteration refuses a line that is too long, such as a sparse file's."""

    def __init__(self, file: BinaryIO, path: str | Path, errors: str) -> None:
        super().__init__(file, encoding="utf-8-sig", errors=errors, newline="")
        self._path = path

    def __next__(self) -> str:  # type: ignore[override]
        line = self.readline(MOST_LINE + 1)
        if len(line) > MOST_LINE:
            raise InputError(
                f"{self._path}: has a row of more than {MOST_LINE:,} characters; name another file"
            )
        if not line:
            raise StopIteration
        return line

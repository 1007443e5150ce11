"""Bounded readers of regular files, and what a file is that is not what its name says.

A pipe, device or folder is refused without waiting for it. The kind and the size are checked on the
opened descriptor, so that the file cannot be replaced in between. A symbolic link to a regular file
is allowed.
"""

import errno
import hashlib
import io
import os
import re
import stat
from pathlib import Path
from typing import BinaryIO, TextIO

from zoo.base.errors import InputError, file_errors

MOST_LINE = 1_000_000  # characters of a row of text
MOST_HASHED_BYTES = 8_000_000_000
MOST_JSON_BYTES = 16_000_000
MOST_YAML_BYTES = 1_000_000
# O_NONBLOCK: opening a pipe does not wait for its writer. Regular files ignore it.
_FLAGS = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
HEAD_BYTES = 64  # of a file, which tell its kind
POINTER = b"version https://git-lfs"
MOST_POINTER_BYTES = 1024  # of a Git LFS pointer, by its specification
# What a file that begins like this is, and what to do; no recording has a file of these kinds.
_KINDS = {
    POINTER: "is a Git LFS pointer, not the file (fetch it: git lfs pull)",
    rb"PK\x03\x04.{26}(\[Content_T|_rels/|docProps|xl/|mimetype)|\xd0\xcf\x11\xe0": (
        "is a spreadsheet (save its sheet as CSV)"
    ),
    rb"PK\x03\x04|\x1f\x8b|BZh\d|\xfd7zXZ|7z\xbc\xaf|Rar!": "is an archive (unpack it)",
    rb"(\xef\xbb\xbf)?\s*<(?i:!doctyp|html|head)": "is a web page (download the file itself)",
    rb"%PDF": "is a PDF (download the file itself)",
    rb"BM.{4}\0\0|GIF8|RIFF....WEBP|II\*\0|MM\0\*|....ftyp(hei|mif|avi)": (
        "is an image of another kind (save it as JPEG or PNG)"
    ),
}
_PATTERNS = [(re.compile(start, re.DOTALL), words) for start, words in _KINDS.items()]


def read_text(path: Path, most_bytes: int) -> str:
    """Return a file's text; raise InputError if it cannot be read, is too large or not UTF-8."""
    try:
        with file_errors(path, "cannot be read ({})"):
            data = read_regular(path, most_bytes)
            check_kind(data[:HEAD_BYTES], path)
            return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: byte {error.start + 1:,} is not UTF-8; save it as UTF-8"
        ) from None


def open_regular(path: str | Path, most_bytes: int) -> tuple[int, int]:
    """Return a regular file's descriptor, for reading, and its size.

    Raises:
        OSError: the file is missing, not regular, above `most_bytes`, or a Git LFS pointer;
            `strerror` says why.
    """
    try:
        descriptor = os.open(path, _FLAGS)
    except ValueError as error:  # a NUL in the path
        raise OSError(errno.EINVAL, str(error), ascii(str(path))) from None
    try:
        status = os.fstat(descriptor)
        if not stat.S_ISREG(status.st_mode):
            kind = "is a directory, no" if stat.S_ISDIR(status.st_mode) else "is no"
            raise OSError(errno.EINVAL, f"{kind} regular file", str(path))
        if status.st_size > most_bytes:
            reason = f"has {status.st_size:,} bytes, more than the {most_bytes:,} that are read"
            raise OSError(errno.EFBIG, reason, str(path))
        if 0 < status.st_size < MOST_POINTER_BYTES:
            if os.read(descriptor, len(POINTER)) == POINTER:
                check_kind(POINTER, path)
            os.lseek(descriptor, 0, os.SEEK_SET)
    except BaseException:
        os.close(descriptor)
        raise
    return descriptor, status.st_size


def read_regular(path: str | Path, most_bytes: int) -> bytes:
    """Return a file's bytes, as many as it had when it was opened.

    It raises what `open_regular` raises. It makes few system calls, because threads queue for
    Python's lock after each.
    """
    descriptor, size = open_regular(path, most_bytes)
    try:
        data = os.read(descriptor, size)
        while len(data) < size and (chunk := os.read(descriptor, size - len(data))):
            data += chunk
        return data
    finally:
        os.close(descriptor)


def hash_file(path: str | Path) -> str:
    """Return the SHA-256 of a file's contents, read in pieces.

    Raises:
        InputError: the file is missing, not regular or too large.
    """
    digest = hashlib.sha256()
    with file_errors(path), open_binary(path, MOST_HASHED_BYTES) as file:
        while piece := file.read(1 << 20):
            digest.update(piece)
    return digest.hexdigest()


def open_binary(path: str | Path, most_bytes: int) -> BinaryIO:
    """Open a regular file for reading; raises what `open_regular` raises."""
    descriptor, size = open_regular(path, most_bytes)
    if not size:  # the kernel's files, such as /proc/kmsg, may be endless
        os.close(descriptor)
        return io.BytesIO()
    return os.fdopen(descriptor, "rb")


def open_data(path: str | Path, most_bytes: int) -> BinaryIO:
    """Open a file of a recording; raises as `open_binary`, and for a file of no such kind."""
    file = open_binary(path, most_bytes)
    try:
        check_kind(file.read(HEAD_BYTES), path)
    except OSError:
        file.close()
        raise
    file.seek(0)
    return file


def open_text(path: str | Path, most_bytes: int, errors: str = "strict") -> TextIO:
    """Open a CSV file, UTF-8 with or without a byte order mark; keep its line ends.

    Raises:
        InputError: the file is missing, not regular, too large, or of another kind.
    """
    with file_errors(path):
        file = open_data(path, most_bytes)
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


def find_kind(head: bytes) -> str | None:
    """Return what a file is that no recording has, by its first bytes; None for all else.

    >>> find_kind(b"<!DOCTYPE html><html>")
    'is a web page (download the file itself)'
    """
    return next((words for start, words in _PATTERNS if start.match(head)), None)


def check_kind(head: bytes, path: str | Path) -> None:
    """Raise OSError for a file whose first bytes are of such a kind; `strerror` says which."""
    if words := find_kind(head):
        raise OSError(errno.EINVAL, words, str(path))

"""Files that are not what their name says, known by their first bytes."""

import errno
import re
from pathlib import Path

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

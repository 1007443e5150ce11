"""Check image files, and link or copy them into another folder, without decoding them."""

import errno
import os
from pathlib import Path

from datamodules.image import HEAD, MOST_IMAGE_BYTES, TAIL, find_fault
from zoo.base.regular_file import open_regular, read_regular

# Errors after which a link is replaced by a copy: another file system, or one without links; a
# file of another user; too many links.
_NO_LINK = {errno.EXDEV, errno.EPERM, errno.EACCES, errno.EMLINK, errno.ENOTSUP, errno.ENOSYS}


def find_file_fault(path: str) -> str | None:
    """Return what is wrong with an image by its first and last bytes, or None.

    A log, or a link in its folder, may name any file. Only images may get into a new folder.
    """
    try:
        descriptor, size = open_regular(path, MOST_IMAGE_BYTES)
        try:
            head = os.read(descriptor, HEAD)
            os.lseek(descriptor, max(size - TAIL, 0), os.SEEK_SET)
            fault = find_fault(head, os.read(descriptor, TAIL))
        finally:
            os.close(descriptor)
    except OSError as error:
        fault = error.strerror or str(error)
    return f"{path}: {fault}" if fault else None


def link_or_copy(path: str, target: Path) -> None:
    """Link a file under another name, or copy it where the file system has no links.

    Raises:
        OSError: the file cannot be read, or the disk is full.
    """
    try:
        os.link(os.path.realpath(path), target)
    except OSError as error:
        if error.errno not in _NO_LINK:
            raise
        target.write_bytes(read_regular(path, MOST_IMAGE_BYTES))

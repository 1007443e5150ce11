"""Write a new folder, which appears under its name when it is complete."""

import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from datamodules.errors import InputError


@contextmanager
def new_folder(out: Path) -> Iterator[Path]:
    """Yield a hidden folder to write to, which becomes `out`; an exception removes it.

    Raises:
        InputError: `out` exists, or a file cannot be written.
    """
    out = out.expanduser().absolute()
    refuse_existing(out)
    part = out.with_name(f".{out.name}.{secrets.token_hex(8)}.part")
    try:
        try:
            part.mkdir(parents=True)
            yield part
            part.rename(out)
        except BaseException:
            shutil.rmtree(part, ignore_errors=True)
            raise
    except OSError as error:
        raise InputError(
            f"{error.filename or out}: {error.strerror}; nothing was written: free some space, or "
            "name another folder with out="
        ) from None


def free_folder(folder: Path) -> Path:
    """Return a folder that does not exist: this one, or its name with `_2`, `_3`, ..."""
    number, found = 1, folder
    while os.path.lexists(found):
        number += 1
        found = folder.with_name(f"{folder.name}_{number}")
    return found


def refuse_existing(out: Path) -> None:
    """Raise InputError if a folder to write exists."""
    if os.path.lexists(out):
        raise InputError(f"out={out}: exists already; name another folder")

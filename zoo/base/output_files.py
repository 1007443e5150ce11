"""The files that users name as outputs, `out=` or `table=`: replaced only with `overwrite=true`.

What a command writes in a folder of its own, such as a run's, needs no check.
"""

import os
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

from zoo.base.command_keys import alternatives
from zoo.base.errors import InputError, UsageError

OUTPUTS = Path("outputs")  # below the current folder
_OVERWRITE: ContextVar[bool] = ContextVar("overwrite", default=False)


@contextmanager
def overwriting(allowed: bool) -> Iterator[None]:
    """Let the outputs that are written in this context replace files, if it is allowed."""
    token = _OVERWRITE.set(allowed or _OVERWRITE.get())
    try:
        yield
    finally:
        _OVERWRITE.reset(token)


def checked_file(
    path: str | Path,
    endings: Collection[str],
    key: str = "out",
    inputs: Sequence[str | Path] = (),
    into_folder: bool = False,
) -> Path:
    """Return the path of a file that a user named; call before long work.

    Args:
        path: file that the command will write.
        endings: allowed endings of its name, such as `.csv`.
        key: key that names it, for the message.
        inputs: files and folders that the command reads.
        into_folder: whether its folder must exist.

    Raises:
        UsageError: the name has another ending; or see `check_output`.
        InputError: there is no such folder; or see `check_output`.
    """
    path = Path(path).expanduser()
    if path.suffix not in endings:
        raise UsageError(f"{key}={path}: must end in {alternatives(endings)}; name such a file")
    if into_folder and not path.parent.is_dir():
        raise InputError(f"{key}={path}: there is no folder {path.parent}; name another file")
    check_output(path, key, inputs)
    return path


def check_output(path: Path, key: str = "out", inputs: Sequence[str | Path] = ()) -> None:
    """Refuse to replace a file without `overwrite=true`, and always one that the command reads.

    A default name below `outputs` is replaced without the key.

    Args:
        path: file that the command will write.
        key: key that names it, for the message; empty for a default name.
        inputs: files and folders that the command reads.

    Raises:
        InputError: the file is an input, or lies in one, or is no regular file.
        UsageError: the file exists and must not be replaced, or is a folder.
    """
    if not os.path.lexists(path):
        return
    named = f"{key}={path}" if key else str(path)
    if any(_is_within(path, Path(read)) for read in inputs):
        raise InputError(f"{named}: is an input of this command; name another file")
    if path.is_dir():
        raise UsageError(f"{named}: is a folder; name another file")
    if path.is_symlink() or not path.is_file():
        raise InputError(f"{named}: exists, and is no regular file; name another file")
    if not (_OVERWRITE.get() or (not key and OUTPUTS.resolve() in path.resolve().parents)):
        raise UsageError(
            f"{named}: exists; name another file, or replace this one with overwrite=true"
        )


def _is_within(path: Path, folder: Path) -> bool:
    """Return whether an existing path is an input, or a file in a folder that is one."""
    try:
        return path.samefile(folder) or Path(os.path.realpath(folder)) in path.resolve().parents
    except (OSError, ValueError, RuntimeError):  # such as a loop of links
        return False

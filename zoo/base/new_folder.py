"""The folders that commands write: created and locked in one place.

`command_folder` is a folder that fills while its command runs, and `whole_folder` one that appears
under its name when it is complete. The first is locked while the command runs; the system releases
the lock when the process ends, also after `kill -9`.
"""

import datetime
import errno
import itertools
import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

from zoo.base.errors import InputError, StoppedError, file_errors
from zoo.base.whole_file import PART, move_whole

LOCK = ".drivezoo.lock"
HIDDEN = ".drivezoo"  # beginning of its name, and of what earlier versions kept in a folder
RECIPE = "recipe.json"  # in a recording of the embedded simulator: what it drove


def dated_folder(kind: str) -> Path:
    """Return `outputs/<kind>/<date>/<time>`, a command's folder if the user names none."""
    now = datetime.datetime.now()
    return Path(f"outputs/{kind}/{now:%Y-%m-%d}/{now:%H-%M-%S-%f}")


@contextmanager
def command_folder(
    out: str | Path | None, kind: str, resumed_by: str = "", key: str = "out="
) -> Iterator[Path]:
    """Yield the empty folder that a command fills: the named one, or that of `dated_folder`.

    Args:
        out: folder that the user named; None for one of the kind and the time.
        kind: kind of what the command writes, such as `evaluations`.
        resumed_by: file with which the command resumes; a folder that has it need not be empty.
        key: key that names the folder, for messages.

    Raises:
        InputError: the folder is not empty; or see `written_folder`.
        StoppedError: on Ctrl-C, if the folder holds something by then.
    """
    folder = Path(out).expanduser() if out else dated_folder(kind)
    with file_errors(folder, f"cannot be written to ({{}}); name another folder with {key}"):
        is_filled = folder.exists() and bool(_names(folder))
    if is_filled and not (resumed_by and (folder / resumed_by).is_file()):
        lack = f" and has no {resumed_by}" if resumed_by else ""
        raise InputError(f"{folder}: is not empty{lack}; name another folder with {key}")
    with written_folder(folder, key):
        try:
            yield folder
        except KeyboardInterrupt:
            if not _names(folder):
                raise
            raise StoppedError(f"stopped; what was finished is in {folder}") from None


@contextmanager
def written_folder(folder: Path, key: str = "out=") -> Iterator[None]:
    """Create and lock a folder for a command; remove it if the command writes nothing.

    Raises:
        InputError: the folder is in use, or cannot be written to.
    """
    with ExitStack() as stack:
        with file_errors(folder, f"cannot be written to ({{}}); name another folder with {key}"):
            created = [parent for parent in (folder, *folder.parents) if not parent.exists()]
            folder.mkdir(parents=True, exist_ok=True)
            stack.callback(_remove_empty, folder, created)
            stack.enter_context(hold_folder(folder, key))
            if not os.access(folder, os.W_OK):  # it was locked before
                raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
        yield


@contextmanager
def hold_folder(folder: Path, key: str = "out=") -> Iterator[None]:
    """Lock a folder for this process, so that no other command writes there.

    Raises:
        InputError: another process holds it.
        OSError: it cannot be written to.
    """
    path = folder / LOCK
    if path.is_symlink():
        raise InputError(f"{path}: is a link; remove it")
    lock = FileLock(path, thread_local=False)  # another thread may release it
    try:
        held = lock.acquire(timeout=0)
    except Timeout:
        raise InputError(
            f"{folder}: another process writes there; wait until it ends, or name another folder "
            f"with {key}FOLDER"
        ) from None
    with held:
        yield


def is_held(folder: Path) -> bool:
    """Return whether a process that is alive holds a folder."""
    path = folder / LOCK
    if path.is_symlink() or not path.is_file():
        return False
    try:
        with FileLock(path, timeout=0):
            return False
    except (Timeout, OSError):
        return True


@contextmanager
def whole_folder(out: Path, key: str = "out=") -> Iterator[Path]:
    """Yield a hidden folder to write to, which becomes `out`; an exception removes it.

    Raises:
        InputError: `out` exists, or a file cannot be written.
    """
    out = out.expanduser().absolute()
    refuse_existing(out, key)
    part = out.with_name(f".{out.name}.{secrets.token_hex(8)}.part")
    try:
        try:
            part.mkdir(parents=True)
            yield part
            (part / LOCK).unlink(missing_ok=True)
            move_whole(part, out)
        except BaseException:
            shutil.rmtree(part, ignore_errors=True)
            raise
    except OSError as error:
        space = "free some space, or " * (error.errno in (errno.ENOSPC, errno.EDQUOT))
        named = str(error.filename or out).replace(str(part), str(out))
        raise InputError(
            f"{named}: {error.strerror}; nothing was written: {space}name another folder with {key}"
        ) from None


def free_folder(folder: Path) -> Path:
    """Return a folder that does not exist: this one, or its name with `_2`, `_3`, ..."""
    others = (folder.with_name(f"{folder.name}_{number}") for number in itertools.count(2))
    return next(path for path in itertools.chain([folder], others) if not os.path.lexists(path))


def refuse_existing(out: Path, key: str = "out=") -> None:
    """Raise InputError if a folder to write exists."""
    if os.path.lexists(out):
        raise InputError(f"{key}{out}: exists already; name another folder")


def _remove_empty(folder: Path, created: list[Path]) -> None:
    """Remove what was created for a command that wrote nothing, unless another one began there."""
    with suppress(OSError):
        if not _names(folder) and not is_held(folder):
            (folder / LOCK).unlink(missing_ok=True)
            for path in created:
                path.rmdir()


def _names(folder: Path) -> set[str]:
    """Return the names in a folder besides its lock and temporary files."""
    names = {path.name for path in folder.iterdir()}
    return {name for name in names if not (name.startswith(HIDDEN) or PART.fullmatch(name))}

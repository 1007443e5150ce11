"""Errors of a stopped run or a lost disk: what is kept, and how to resume."""

import io
import threading
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from zoo.base.errors import InputError, StoppedError
from zoo.base.terminal import command_line
from zoo.cli.parts import typed_parts
from zoo.runs.status import read_status


@contextmanager
def naming_lost_files(folder: Path) -> Iterator[None]:
    """Raise InputError for a full disk or a removed folder; name the file and what is kept."""
    before = threading.excepthook
    # TensorBoard writes in a thread; the main thread raises its errors, too.
    threading.excepthook = lambda failed: isinstance(failed.exc_value, OSError) or before(failed)
    try:
        yield
    except OSError as error:
        place = error.filename or _open_file(error) or folder
        if not folder.is_dir():
            remedy = f"{folder} was removed, with all that the run had saved; start the run again"
        else:
            last = folder / "checkpoints" / "last.ckpt"
            kept = f"{last} is kept" if last.is_file() else kept_without_last(folder)
            again = resume_command(folder)
            remedy = f"{kept}; free some space, and resume with: {again}"
        raise InputError(f"{place}: {error.strerror or error}; {remedy}") from error
    finally:
        threading.excepthook = before


def _open_file(error: OSError) -> str | None:
    """Return the name of the file that the failed code had open; a write error lacks it."""
    for frame, _ in reversed(list(traceback.walk_tb(error.__traceback__))):
        for one in frame.f_locals.values():
            if isinstance(one, io.IOBase) and isinstance(getattr(one, "name", None), str):
                return one.name
    return None


def resume_command(folder: Path) -> str:
    """Return the command that resumes a run."""
    return command_line(["drivezoo", "train", f"resume={folder}", *typed_parts()])


def kept_without_last(folder: Path) -> str:
    """Return which checkpoint is kept in a run's folder that holds no `last.ckpt`."""
    best = folder / "checkpoints" / "best.ckpt"
    if not best.is_file():
        return "no epoch was complete yet"
    return f"{best} is kept, but there is no last.ckpt to resume from"


def stopped_error(folder: Path, epoch: int) -> StoppedError:
    """Return the error of a training that was stopped in `epoch`, counted from 1."""
    done = f"the epochs before {epoch} are saved"
    if not (folder / "checkpoints" / "last.ckpt").is_file():
        done = kept_without_last(folder)
    if (finished := read_status(folder).get("finished_epochs")) is not None:
        done += f"; metrics.json holds the figures of {finished} finished epochs"
    return StoppedError(f"stopped; {done}; resume with: {resume_command(folder)}")

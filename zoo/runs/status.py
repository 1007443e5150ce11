"""`status.json`: whether a run is going on, has finished, was pruned, or failed and why."""

import json
import os
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import datetime, timezone
from pathlib import Path

import psutil
from filelock import FileLock

from datamodules.errors import InputError
from zoo.cli.stop_errors import PrunedError
from zoo.runs.whole_file import remove_parts, write_whole

NAME = "status.json"
# A run on another machine shows that it lives by touching its file, which its clock dates.
BEAT_S, GONE_S = 20.0, 180.0


@contextmanager
def run_status(folder: Path, first: bool = True) -> Iterator[None]:
    """`running` within, then `finished`, `pruned`, or `failed` with the reason, whatever it is.

    Of processes that train together the `first` alone writes it.

    Raises:
        InputError: see `claim_run`.
    """
    if not first:
        yield
        return
    claim_run(folder)
    for place in (folder, folder / "checkpoints", folder / "report"):
        remove_parts(place)
    over = threading.Event()
    threading.Thread(target=_beat, args=(folder / NAME, over), daemon=True).start()
    status, reason = "finished", {}
    try:
        yield
    except BaseException as error:
        said = str(error) or type(error).__name__
        status = "pruned" if isinstance(error, PrunedError) else "failed"
        reason = {"reason": said.splitlines()[0]}
        raise
    finally:
        over.set()
        try:
            write_status(folder, status, **reason)
        except OSError:  # of a full disk, or a folder that was removed
            if status == "finished":
                raise


def claim_run(folder: Path, check: Callable[[Path], None] = lambda _: None) -> None:
    """Write `running`, unless another process runs in the folder.

    A sweep's job claims its folder before the process that it starts for the training does.

    Args:
        check: raises where the folder must not be claimed; no process claims it meanwhile.

    Raises:
        InputError: another process, which lives, has claimed it.
    """
    with FileLock(folder / "status.lock"):
        before = read_status(folder)
        ours = before.get("pid") in (os.getpid(), os.getppid()) and _is_here(before)
        if not ours and is_beating(folder):
            raise InputError(
                f"{folder}: process {before.get('pid')} on {before.get('host')} is training there; "
                "wait until it has finished, stop it, or name another folder: hydra.run.dir=FOLDER"
            )
        check(folder)
        more = {}
        if before.get("status") == "finished":
            more = {"finished_epochs": read_metrics(folder).get("epochs")}
        write_status(folder, "running", **more)


def read_metrics(folder: Path) -> dict:
    """Return what `metrics.json` holds; an empty dict where there is none to read."""
    from zoo.runs.metrics_file import read_metrics_file

    try:
        return read_metrics_file(folder)
    except InputError:
        return {}


def write_status(folder: Path, status: str, **more: object) -> None:
    """Replace the file at once, so that a reader never sees half of it.

    A finished run that was resumed keeps `finished_epochs`, of which `metrics.json` holds the
    figures, until it has finished again.
    """
    earlier = read_status(folder).get("finished_epochs")
    if earlier is not None and status != "finished":
        more = {"finished_epochs": earlier, **more}
    contents = {
        "status": status,
        "pid": os.getpid(),
        "host": socket.gethostname(),
        # A process's number is given out again; with the time of its start it is one of its kind.
        "process_started": psutil.Process().create_time(),
        "time": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        **more,
    }
    write_whole(folder / NAME, json.dumps(contents, indent=2))


def read_status(folder: Path) -> dict:
    """Return what `write_status` wrote last; an empty dict where there is none that can be read."""
    from zoo.runs.status_file import read_status_file

    try:
        return read_status_file(folder)
    except InputError:
        return {}


def _is_here(status: dict) -> bool:
    return (status.get("host") or socket.gethostname()) == socket.gethostname()


def is_alive(folder: Path) -> bool:
    """Whether the process that runs in `folder` is there; False where none does.

    On this machine the process itself is asked for. Another machine's must have touched its
    `status.json` within three minutes, by our clock.
    """
    status = read_status(folder)
    if status.get("status") != "running":
        return False
    if not _is_here(status):
        return time.time() - (folder / NAME).stat().st_mtime < GONE_S
    try:
        process = psutil.Process(status["pid"])
        started = process.create_time()
        gone = process.status() == psutil.STATUS_ZOMBIE
    except (psutil.Error, KeyError, TypeError, ValueError, OverflowError):
        return False
    return not gone and abs(started - (status.get("process_started") or started)) < 2


def is_beating(folder: Path) -> bool:
    """`is_alive`, and where another machine's process might be: whether it gives a sign of life
    within three of its beats. One that was stopped a moment ago looks alive for minutes."""
    if not is_alive(folder) or read_status(folder).get("host") == socket.gethostname():
        return is_alive(folder)
    before, until = (folder / NAME).stat().st_mtime, time.monotonic() + 3 * BEAT_S
    while time.monotonic() < until:
        if (folder / NAME).stat().st_mtime != before:
            return is_alive(folder)
        time.sleep(1)
    return False


def _beat(path: Path, over: threading.Event) -> None:
    while not over.wait(BEAT_S):
        try:
            os.utime(path)
        except OSError:  # the folder was removed, or its disk is away for a moment
            continue

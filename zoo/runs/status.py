"""Write and read `status.json`: running, finished, stopped, pruned or failed, and why."""

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

from zoo.base.errors import InputError, PrunedError, StoppedError
from zoo.base.plain_files import read_json
from zoo.base.whole_file import remove_parts, write_whole
from zoo.runs.metrics_file import read_metrics_file
from zoo.runs.record_fields import Fields, Number, Whole, check_fields, plain

NAME = "status.json"
# Every BEAT_S a run touches its file; after GONE_S without it, other machines count it as dead.
BEAT_S, GONE_S = 20.0, 180.0


class Status(Fields):
    """The contents of `status.json`, as `write_status` writes it."""

    status: str | None = None
    reason: str | None = None
    pid: Whole | None = None
    host: str | None = None
    process_started: Number | None = None
    time: str | None = None
    finished_epochs: Whole | None = None


@contextmanager
def run_status(folder: Path, first: bool = True) -> Iterator[None]:
    """Write `running` at the start, and at the end `finished`, `stopped`, `pruned` or `failed`.

    Args:
        folder: run's folder.
        first: whether this process is the first rank; the other ranks write nothing.

    Raises:
        InputError: see `claim_run`.
    """
    if not first:
        yield
        return
    claim_run(folder)
    for path in (folder, folder / "checkpoints", folder / "report"):
        remove_parts(path)
    over = threading.Event()
    threading.Thread(target=_beat, args=(folder / NAME, over), daemon=True).start()
    status, reason = "finished", {}
    try:
        yield
    except BaseException as error:
        message = str(error) or type(error).__name__
        ends = {PrunedError: "pruned", StoppedError: "stopped", KeyboardInterrupt: "stopped"}
        status = next((end for kind, end in ends.items() if isinstance(error, kind)), "failed")
        reason = {"reason": message.splitlines()[0]}
        raise
    finally:
        over.set()
        try:
            write_status(folder, status, **reason)
        except OSError:  # a full disk, or the folder was removed
            if status == "finished":
                raise


def claim_run(folder: Path, check: Callable[[Path], None] = lambda _: None) -> None:
    """Write `running`, unless another process runs in the folder.

    A sweep's job claims its folder, and then the training process that it starts claims it again.

    Args:
        folder: run's folder.
        check: function that raises if the folder must not be claimed; it runs under the lock.

    Raises:
        InputError: another process that is still alive has claimed the folder.
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
        fields = {}
        if before.get("status") == "finished":
            fields = {"finished_epochs": read_metrics(folder).get("epochs")}
        write_status(folder, "running", **fields)


def read_metrics(folder: Path) -> dict:
    """Return the contents of `metrics.json`; an empty dict if it is missing or damaged."""
    try:
        return read_metrics_file(folder)
    except InputError:
        return {}


def write_status(folder: Path, status: str, **more: object) -> None:
    """Replace `status.json` in one step, so that a reader never sees half of it.

    A finished run that was resumed keeps `finished_epochs` until it has finished again: until then
    `metrics.json` holds the figures of that number of epochs.
    """
    earlier = read_status(folder).get("finished_epochs")
    if earlier is not None and status != "finished":
        more = {"finished_epochs": earlier, **more}
    contents = {
        "status": status,
        "pid": os.getpid(),
        "host": socket.gethostname(),
        # The system reuses process ids; the start time makes the process unique.
        "process_started": psutil.Process().create_time(),
        "time": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        **more,
    }
    write_whole(folder / NAME, json.dumps(contents, indent=2))


def read_status_file(folder: Path) -> dict:
    """Return a run's status as plain containers; an empty dict without a file.

    Raises:
        InputError: the file cannot be read.
    """
    path = folder / NAME
    return plain(check_fields(Status, read_json(path), path)) if path.exists() else {}


def read_status(folder: Path) -> dict:
    """Return the contents of `status.json`; an empty dict if it is missing or damaged."""
    try:
        return read_status_file(folder)
    except InputError:
        return {}


def _is_here(status: dict) -> bool:
    return (status.get("host") or socket.gethostname()) == socket.gethostname()


def is_alive(folder: Path) -> bool:
    """Return whether the run in `folder` is running and its process exists.

    A process on another machine must have touched `status.json` in the last three minutes, by the
    clock of this machine.
    """
    status = read_status(folder)
    if status.get("status") != "running":
        return False
    if not _is_here(status):
        return time.time() - (folder / NAME).stat().st_mtime < GONE_S
    try:
        process = psutil.Process(int(status["pid"]))  # of None psutil takes this process
        started = process.create_time()
        gone = process.status() == psutil.STATUS_ZOMBIE
    except (psutil.Error, KeyError, TypeError, ValueError, OverflowError):
        return False
    return not gone and abs(started - (status.get("process_started") or started)) < 2


def is_beating(folder: Path) -> bool:
    """Return whether a run is alive, and for another machine's process wait for a sign of life.

    A process that was just stopped looks alive to `is_alive` for minutes, so wait for up to three
    beats until the process touches `status.json`.
    """
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
        except OSError:  # the folder was removed, or its disk is not available now
            continue

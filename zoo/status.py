"""`status.json`: whether a run is going on, has finished, or failed and why."""

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime, timezone
from pathlib import Path

NAME = "status.json"


class StoppedError(Exception):
    """A person stopped the training; the message says how to go on."""


@contextmanager
def run_status(folder: Path) -> Iterator[None]:
    """`running` within, then `finished`, or `failed` with the reason; whatever the exception."""
    if not is_first_process():
        yield
        return
    write_status(folder, "running")
    try:
        yield
    except BaseException as error:
        reason = str(error) or type(error).__name__
        write_status(folder, "failed", reason=reason.splitlines()[0])
        raise
    write_status(folder, "finished")


def is_first_process() -> bool:
    """False in those that Lightning starts beside the first to train on several devices."""
    return os.environ.get("LOCAL_RANK", "0") == "0"


def write_status(folder: Path, status: str, **more: str) -> None:
    """Replace the file at once, so that a reader never sees half of it."""
    now = datetime.now(timezone.utc).isoformat(timespec="seconds")
    contents = {"status": status, "pid": os.getpid(), "time": now, **more}
    part = folder / f"{NAME}.part"
    part.write_text(json.dumps(contents, indent=2))
    part.replace(folder / NAME)


def read_status(folder: Path) -> dict:
    """What `write_status` wrote last; an empty dict where nothing did."""
    path = folder / NAME
    return json.loads(path.read_text()) if path.is_file() else {}

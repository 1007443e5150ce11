"""Launches jobs until each has had its turn, whatever happens to the processes that train them."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from datamodules.errors import InputError
from zoo.runs.status import is_alive, read_status, write_status
from zoo.sweep.sweep_job import DONE

POLL_S = 1.0
DIED = "its process died without a word: killed, or out of memory"

Launch = Callable[[Sequence["Job"]], None]


@dataclass(frozen=True)
class Job:
    """A job of a sweep: its folder is called by its number."""

    number: int
    overrides: tuple[str, ...]
    folder: Path

    @property
    def is_done(self) -> bool:
        return read_status(self.folder).get("status") in DONE


def launch_all(launch: Launch, jobs: Sequence[Job], console: Console) -> None:
    """Give each job that is not done one turn; those that another process trains are waited for.

    A launcher can break: a pool of processes does when one of them is killed, and takes its
    neighbours along. Who was training then is tried again alone, so that only the one at fault
    fails, and the others go on.

    Raises:
        InputError: the launcher can't start any job.
    """
    waiting = [job for job in jobs if not job.is_done and not is_alive(job.folder)]
    while waiting:
        before = {job: read_status(job.folder) for job in waiting}
        broken = _try_launch(launch, waiting)
        _wait(waiting, console)
        died = [job for job in waiting if read_status(job.folder).get("status") == "running"]
        if broken and len(waiting) > 1:
            for job in died:
                console.print(
                    f"job {job.number}: {DIED}; trying again, alone", highlight=False, markup=False
                )
                _try_launch(launch, [job])
        for job in died:
            if read_status(job.folder).get("status") == "running" and not is_alive(job.folder):
                write_status(job.folder, "failed", reason=DIED)
        untouched = [job for job in waiting if read_status(job.folder) == before[job]]
        if broken and len(untouched) == len(waiting):
            raise InputError(f"the launcher could not start a job: {_said(broken)}") from broken
        waiting = untouched if broken else []
    _wait(jobs, console)


def _try_launch(launch: Launch, jobs: Sequence[Job]) -> Exception | None:
    try:
        launch(jobs)
    except Exception as error:  # each launcher has errors of its own, and some a job's
        return error
    return None


def _wait(jobs: Sequence[Job], console: Console) -> None:
    """Until no living process trains any of these: a killed sweep's workers finish their job."""
    alive = [job for job in jobs if is_alive(job.folder)]
    for job in alive:
        status = read_status(job.folder)
        console.print(
            f"job {job.number}: waiting for process {status.get('pid')} on {status.get('host')}, "
            "which is training it",
            highlight=False,
            markup=False,
        )
    while any(is_alive(job.folder) for job in alive):
        time.sleep(POLL_S)


def _said(error: Exception) -> str:
    """An error's line that says most: some begin with an empty one or with a heading."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return f"{type(error).__name__}: {lines[-1]}" if lines else type(error).__name__

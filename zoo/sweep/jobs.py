"""The jobs of a sweep: launch them all, report how each ended, and find those that were killed."""

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from zoo.base.errors import InputError
from zoo.leaderboard.scored import finished_run
from zoo.runs.status import is_alive, read_status, write_status
from zoo.sweep.sweep_record import varying

DONE = ("finished", "pruned")
POLL_S, WATCH_S = 1.0, 0.5
DIED = "its process ended without an error: it was killed, or memory ran out"

Launch = Callable[[Sequence["Job"]], None]


@dataclass(frozen=True)
class Job:
    """A job of a sweep, in a folder named by the job's number."""

    number: int
    overrides: tuple[str, ...]
    folder: Path

    @property
    def is_done(self) -> bool:
        """Return whether the job has finished or was pruned."""
        return read_status(self.folder).get("status") in DONE


def result_text(folder: Path) -> str:
    """Return how the job in a folder ended: its figures, or the reason of its failure."""
    status = read_status(folder)
    run = finished_run(folder) if status.get("status") == "finished" else None
    if run is None:
        return ": ".join(filter(None, [status.get("status"), status.get("reason")]))
    figures = [] if run.autonomy is None else [f"autonomy {run.autonomy:.1%}"]
    figures += [] if run.val_mse is None else [f"val MSE {run.val_mse:.4f}"]
    return f"finished in {run.wall_s:.0f} s" + "".join(f", {figure}" for figure in figures)


@contextmanager
def watched(jobs: Sequence[Job], console: Console) -> Iterator[None]:
    """Print a line when a job ends; parallel jobs print only to their log files."""
    before = {job: read_status(job.folder) for job in jobs}
    stopped = threading.Event()
    varied = varying([job.overrides for job in jobs])
    reported = {job for job in jobs if job.is_done}
    count = len(reported)
    lock = threading.Lock()

    def report_ended() -> None:
        nonlocal count
        with lock:
            for job in jobs:
                status = read_status(job.folder)
                if job in reported or status == before[job] or status.get("status") == "running":
                    continue
                reported.add(job)
                count += 1
                line = f"{count}/{len(jobs)}  job {job.number} ({varied[job.overrides]}): "
                line += result_text(job.folder)
                console.print(line, highlight=False, markup=False)

    def poll() -> None:
        while not stopped.wait(WATCH_S):
            report_ended()

    thread = threading.Thread(target=poll, daemon=True)
    thread.start()
    try:
        yield
    finally:
        stopped.set()
        thread.join()
        report_ended()


def launch_all(launch: Launch, jobs: Sequence[Job], console: Console) -> None:
    """Launch each job that is not done once, and wait for jobs that another process trains.

    When one process of a pool is killed, the launcher can end the whole pool. Each job that was
    training then runs again alone, so that only the job at fault fails.

    Raises:
        InputError: the launcher cannot start any job.
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
                    f"job {job.number}: {DIED}; running it again, alone",
                    highlight=False,
                    markup=False,
                )
                _try_launch(launch, [job])
        for job in died:
            if read_status(job.folder).get("status") == "running" and not is_alive(job.folder):
                write_status(job.folder, "failed", reason=DIED)
        untouched = [job for job in waiting if read_status(job.folder) == before[job]]
        if broken and len(untouched) == len(waiting):
            reason = _last_line(broken)
            raise InputError(f"the launcher could not start a job: {reason}") from broken
        waiting = untouched if broken else []
    _wait(jobs, console)


def _try_launch(launch: Launch, jobs: Sequence[Job]) -> Exception | None:
    try:
        launch(jobs)
    except Exception as error:  # launchers raise their own errors, and some raise a job's
        return error
    return None


def _wait(jobs: Sequence[Job], console: Console) -> None:
    """Wait until no process trains these jobs: workers of a killed sweep finish theirs."""
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


def _last_line(error: Exception) -> str:
    """Return an error's type and last line; the first lines can be empty or a heading."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return f"{type(error).__name__}: {lines[-1]}" if lines else type(error).__name__

"""Says which job of a sweep has ended, wherever it ran, by looking at its folder."""

import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from rich.console import Console

from zoo.leaderboard.ranking import read_run
from zoo.runs.status import read_status
from zoo.sweep.launch_rounds import Job
from zoo.sweep.sweep_record import varying

LOOK_S = 0.5


@contextmanager
def watched(jobs: Sequence[Job], console: Console) -> Iterator[None]:
    """Print a line as each job ends, which prints nothing itself."""
    before = {job: read_status(job.folder) for job in jobs}
    over = threading.Event()
    varied = varying([job.overrides for job in jobs])
    told = {job for job in jobs if job.is_done}
    count = len(told)
    lock = threading.Lock()

    def look() -> None:
        nonlocal count
        with lock:
            for job in jobs:
                status = read_status(job.folder)
                if job in told or status == before[job] or status.get("status") == "running":
                    continue
                told.add(job)
                count += 1
                said = f"{count}/{len(jobs)}  job {job.number} ({varied[job.overrides]}): "
                said += _outcome(job, status)
                console.print(said, highlight=False, markup=False)

    def keep_looking() -> None:
        while not over.wait(LOOK_S):
            look()

    thread = threading.Thread(target=keep_looking, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
        look()


def _outcome(job: Job, status: dict) -> str:
    run = read_run(job.folder) if status["status"] == "finished" else None
    if run is None:
        return ": ".join(filter(None, [status["status"], status.get("reason")]))
    figures = [] if run.autonomy is None else [f"autonomy {run.autonomy:.1%}"]
    figures += [] if run.val_mse is None else [f"val MSE {run.val_mse:.4f}"]
    return f"finished in {run.wall_s:.0f} s" + "".join(f", {one}" for one in figures)

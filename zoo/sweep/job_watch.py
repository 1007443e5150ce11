"""Reports of jobs that ended, on any machine, found by polling their folders."""

import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from rich.console import Console

from zoo.runs.status import read_status
from zoo.sweep.job_result import result_text
from zoo.sweep.launch_rounds import Job
from zoo.sweep.sweep_record import varying

POLL_S = 0.5


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
        while not stopped.wait(POLL_S):
            report_ended()

    thread = threading.Thread(target=poll, daemon=True)
    thread.start()
    try:
        yield
    finally:
        stopped.set()
        thread.join()
        report_ended()

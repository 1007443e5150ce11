"""Drives in several processes in parallel."""

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import partial
from typing import TypeVar

import numpy as np

from datamodules.errors import InputError
from simulator.spawned_processes import hidden_script

Result = TypeVar("Result")
Shares = Sequence[float]  # share of each job that is done, 0..1
LOOK_S = 0.2  # seconds between two updates of the progress

_shares: Shares | None = None  # in a process of the pool: memory shared by all processes


def drive_in_processes(
    drive: Callable[..., Result],
    jobs: Sequence[tuple],
    workers: int,
    show: Callable[[float], None] = lambda share: None,
    sizes: Sequence[float] | None = None,
) -> Iterator[tuple[int, Result]]:
    """Yield the number and result of each job, in the order in which they finish.

    A result is what `drive(*job, report)` returns. A single process is this one, since starting
    another takes seconds.

    Args:
        drive: function at the top level of a module; it calls `report(share)` with the share of the
            job that is done, 0..1.
        jobs: arguments of each drive.
        workers: number of processes; 0 for one per core.
        show: function called with the share of all jobs that is done, 0..1.
        sizes: amount of work of each job, in any unit; None for equal jobs.

    Raises:
        InputError: a process was killed, for example because memory ran out.
        Exception: a job failed; jobs that have not begun are cancelled.
    """
    if not jobs:
        return
    processes = min(workers or os.cpu_count() or 1, len(jobs))
    weights = np.ones(len(jobs)) if sizes is None else np.asarray(sizes, np.float64)
    weights = weights / weights.sum()
    if processes == 1:
        shares = np.zeros(len(jobs))

        def report(share: float, number: int) -> None:
            shares[number] = share
            show(float(weights @ shares))

        for number, job in enumerate(jobs):
            yield number, drive(*job, partial(report, number=number))
            report(1.0, number)
        return
    # Spawned: PyTorch's and Panda3D's threads do not survive a fork.
    context = multiprocessing.get_context("spawn")
    shares = context.RawArray("d", len(jobs))
    with ProcessPoolExecutor(processes, context, _begin_process, (shares,)) as pool:
        with hidden_script():
            numbers = {
                pool.submit(_drive, drive, number, job): number for number, job in enumerate(jobs)
            }
        waiting = set(numbers)
        with cancelling_pool(pool, processes):
            while waiting:
                finished, waiting = wait(waiting, LOOK_S, FIRST_COMPLETED)
                for one in finished:
                    yield numbers[one], one.result()
                    shares[numbers[one]] = 1.0
                show(float(weights @ shares))


@contextmanager
def cancelling_pool(pool: ProcessPoolExecutor, processes: int) -> Iterator[None]:
    """Cancel the jobs that have not begun after a drive's error or Ctrl-C.

    Raises:
        InputError: a process of the pool was killed, for example because memory ran out.
    """
    try:
        yield
    except BrokenProcessPool:
        raise InputError(
            "workers: a driving process was killed, perhaps because memory ran out; try "
            f"workers={max(1, processes // 2)}"
        ) from None
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        raise


def _begin_process(shares: Shares) -> None:
    """Keep the shared memory, and end without a traceback on Ctrl-C; the parent prints a line."""
    global _shares
    _shares = shares
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def _drive(drive: Callable[..., Result], number: int, job: tuple) -> Result:
    return drive(*job, partial(_shares.__setitem__, number))

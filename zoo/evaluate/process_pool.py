"""Drives in several processes at once."""

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from typing import TypeVar

from datamodules.errors import InputError

Result = TypeVar("Result")
Shares = Sequence[float]  # of each job, how much is done, 0..1
LOOK_S = 0.2  # between two looks at how far the processes are

_shares: Shares | None = None  # in a process of the pool: memory that all of them share


def drive_in_processes(
    drive: Callable[..., Result],
    jobs: Sequence[tuple],
    workers: int,
    show: Callable[[float], None] = lambda share: None,
) -> Iterator[tuple[int, Result]]:
    """Yield the number of each job and what `drive(*job, report)` returns, as they are done.

    Args:
        drive: function of a module, which processes can import; it calls `report(share)` with how
            much of the job is done, 0..1.
        jobs: arguments of each drive.
        workers: number of processes; 0 for one a core. Where one is enough it is this one: another
            would cost seconds.
        show: called with how much of all jobs is done, 0..1, while they are.

    Raises:
        InputError: the processes were killed, as where memory ran out.
        Exception: whatever a job raises; what has not begun by then never does.
    """
    processes = min(workers or os.cpu_count() or 1, len(jobs))
    if processes == 1:
        for number, job in enumerate(jobs):
            yield number, drive(*job, lambda share, done=number: show((done + share) / len(jobs)))
            show((number + 1) / len(jobs))
        return
    # Spawned: PyTorch's and Panda3D's threads do not survive a fork.
    context = multiprocessing.get_context("spawn")
    shares = context.RawArray("d", len(jobs))
    with ProcessPoolExecutor(processes, context, _begin_process, (shares,)) as pool:
        numbers = {
            pool.submit(_drive, drive, number, job): number for number, job in enumerate(jobs)
        }
        waiting = set(numbers)
        try:
            while waiting:
                finished, waiting = wait(waiting, LOOK_S, FIRST_COMPLETED)
                for one in finished:
                    yield numbers[one], one.result()
                    shares[numbers[one]] = 1.0
                show(sum(shares) / len(jobs))
        except BrokenProcessPool:
            raise InputError(
                f"a process that drove was ended from outside; try workers={max(1, processes // 2)}"
            ) from None
        except BaseException:  # a drive's error, or Ctrl-C: what has not begun need not
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _begin_process(shares: Shares) -> None:
    """On Ctrl-C the process that started this one speaks; this one ends without a trace."""
    global _shares
    _shares = shares
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def _drive(drive: Callable[..., Result], number: int, job: tuple) -> Result:
    return drive(*job, partial(_shares.__setitem__, number))

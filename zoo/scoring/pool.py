"""Drives in several processes at once."""

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from typing import TypeVar

from datamodules.errors import InputError

Result = TypeVar("Result")


def drive_in_processes(
    drive: Callable[..., Result], jobs: Sequence[tuple], workers: int
) -> Iterator[tuple[int, Result]]:
    """The number of each job and what `drive(*job)` returns, as they are done.

    Args:
        drive: a function of a module, which processes can import.
        workers: how many processes; 0 for one a core. Where one is enough it is this one: another
            would cost seconds.

    Raises:
        InputError: the processes were killed, as where memory ran out.
        Exception: whatever a job raises; what has not begun by then never does.
    """
    processes = min(workers or os.cpu_count() or 1, len(jobs))
    if processes == 1:
        yield from ((number, drive(*job)) for number, job in enumerate(jobs))
        return
    # Spawned: PyTorch's and Panda3D's threads do not survive a fork.
    context = multiprocessing.get_context("spawn")
    # On Ctrl-C this process speaks; the others end without a trace.
    quiet = (signal.SIGINT, signal.SIG_DFL)
    with ProcessPoolExecutor(processes, context, signal.signal, quiet) as pool:
        waiting = {pool.submit(drive, *job): number for number, job in enumerate(jobs)}
        try:
            for done in as_completed(waiting):
                yield waiting[done], done.result()
        except BrokenProcessPool:
            raise InputError(
                f"a process that drove was ended from outside; try workers={max(1, processes // 2)}"
            ) from None
        except BaseException:  # a drive's error, or Ctrl-C: what has not begun need not
            pool.shutdown(wait=False, cancel_futures=True)
            raise

"""Processes that run jobs in parallel, or read a stranger's file; they end with this process."""

import multiprocessing
import os
import pickle
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager, suppress
from multiprocessing import resource_tracker
from multiprocessing.process import BaseProcess
from multiprocessing.reduction import ForkingPickler
from pathlib import Path
from types import ModuleType
from typing import Annotated, Any, Protocol, TypeVar

import numpy as np

from zoo.base.child_process import end_after, limit_resource
from zoo.base.command_keys import EntryChoice
from zoo.base.errors import InputError, UsageError
from zoo.base.machine import usable_cores
from zoo.base.run_command import held_interrupt

Result = TypeVar("Result")
PROCESSES, EXECUTORS = "processes", "drivezoo.executors"  # this module's; the others' group
Executor = Annotated[str, EntryChoice(EXECUTORS, own=(PROCESSES,))]
LOOK_S = 0.2  # seconds between two updates of the progress
# Limits of `read_apart` for a small file, and for each byte of a larger one.
READ_S, BYTES_PER_S = 30.0, 10e6
FREE_BYTES, COPIES = 1_000_000_000, 4
_starting = threading.Lock()  # pools of several threads tell their processes apart
_reports: Any = None  # queue of job numbers and shares, in a process of a pool


class KilledProcessError(InputError):
    """A process of a pool was killed, for example because memory ran out."""


class ProcessPool(AbstractContextManager):
    """Processes that run jobs.

    At the end of the `with` block they are killed, whatever they are doing. Each looks whether this
    process still runs, and ends with it. Ctrl-C does not reach them: this process ends them.

    Args:
        processes: number of processes.
        key: key of the command that sets the number, for messages.
    """

    def __init__(self, processes: int, key: str = "workers") -> None:
        self.processes, self.key = processes, key
        self.shares: dict[int, float] = {}  # finished share of running jobs, 0..1
        if os.name != "nt":
            # A killed command leaves semaphores, of which the tracker would warn.
            sys.warnoptions.append("ignore:resource_tracker:UserWarning")
            resource_tracker.ensure_running()  # now: its start clears the mask of signals
            sys.warnoptions.pop()
        # Spawned: PyTorch's and Panda3D's threads do not survive a fork.
        context = multiprocessing.get_context("spawn")
        self._reports = context.SimpleQueue()
        begin = os.getpid(), self._reports
        self._executor = ProcessPoolExecutor(processes, context, _begin, begin)
        self._children: set[BaseProcess] = set()
        self._numbers: dict[Future, int] = {}
        self._submitted = 0

    def __exit__(self, *error: object) -> None:
        for child in self._children:
            child.kill()  # its jobs are done, or of no use
        self._executor.shutdown(cancel_futures=True)

    def submit(self, function: Callable, *arguments: object) -> int:
        """Queue `function(*arguments, report)`, and return the job's number.

        Args:
            function: function at the top level of a module; it may call `report(share)` with the
                share of the job that is done, 0..1.
            arguments: arguments that can be pickled.

        Raises:
            UsageError: an argument cannot be pickled, such as an object of a script's own class.
        """
        try:
            with _starting, hidden_script(), held_interrupt():
                others = {*multiprocessing.active_children()}
                job = bytes(ForkingPickler.dumps((function, arguments)))  # also sockets
                future = self._executor.submit(_run, self._submitted, job)
                self._children |= {*multiprocessing.active_children()} - others
        except BrokenProcessPool:
            raise self._killed() from None
        except (pickle.PicklingError, AttributeError, TypeError) as error:
            raise UsageError(
                f"{self.key}={self.processes}: {error}; define it in a module that your script "
                f"imports, or set {self.key}=1"
            ) from None
        self._numbers[future] = self._submitted
        self._submitted += 1
        return self._submitted - 1

    def finished(self, wait_s: float) -> list[tuple[int, Any]]:
        """Return the numbers and results of jobs that have finished.

        Args:
            wait_s: seconds to wait for the first.

        Raises:
            KilledProcessError: a process was killed.
            Exception: a job failed.
        """
        done, _ = wait(self._numbers, wait_s, FIRST_COMPLETED)
        while not self._reports.empty():
            number, share = self._reports.get()
            self.shares[number] = share
        results = []
        for future in done:
            number = self._numbers.pop(future)
            self.shares.pop(number, None)
            try:
                results.append((number, future.result()))
            except BrokenProcessPool:
                raise self._killed() from None
        return results

    def used_bytes(self) -> int:
        """Return the memory that the processes take at this moment."""
        import psutil  # slow

        used = 0
        for child in self._children:
            with suppress(psutil.Error):  # it has ended
                used += psutil.Process(child.pid).memory_info().rss
        return used

    def _killed(self) -> KilledProcessError:
        return KilledProcessError(
            f"{self.key}={self.processes}: a process was killed, perhaps because memory ran out; "
            f"try {self.key}={max(1, self.processes // 2)}"
        )


class Pool(Protocol):
    """What runs jobs: processes of this machine, this process, or a cluster."""

    shares: dict[int, float]

    def submit(self, function: Callable, *arguments: object) -> int:
        """Queue `function(*arguments, report)`, and return the job's number."""

    def finished(self, wait_s: float) -> list[tuple[int, Any]]:
        """Return the numbers and results of jobs that have finished."""


class ThisProcess:
    """A pool without further processes, since starting one takes seconds; see `ProcessPool`."""

    def __init__(self) -> None:
        self.shares: dict[int, float] = {}
        self.show: Callable[[], None] = lambda: None  # called when a share changes
        self._queue: deque[tuple[int, Callable, tuple]] = deque()
        self._submitted = 0

    def submit(self, function: Callable, *arguments: object) -> int:
        """Queue a job, and return its number."""
        self._queue.append((self._submitted, function, arguments))
        self._submitted += 1
        return self._submitted - 1

    def finished(self, wait_s: float) -> list[tuple[int, Any]]:
        """Run the next job, and return its number and result."""
        number, function, arguments = self._queue.popleft()

        def report(share: float) -> None:
            self.shares[number] = share
            self.show()

        return [(number, function(*arguments, report))]


@contextmanager
def opened_pool(workers: int, most: int) -> Iterator[Pool]:
    """Open a pool for several calls of `run_jobs`; one process, or a daemon's, is this one.

    Args:
        workers: number of processes; 0 for one per core.
        most: largest number of processes.
    """
    processes = min(workers or usable_cores(), most)
    if processes <= 1 or multiprocessing.current_process().daemon:  # which may start none
        yield ThisProcess()
        return
    with ProcessPool(processes) as pool:
        yield pool


def run_jobs(
    pool: Pool,
    function: Callable[..., Result],
    jobs: Sequence[tuple],
    show: Callable[[float], None] = lambda share: None,
    sizes: Sequence[float] | None = None,
) -> Iterator[tuple[int, Result]]:
    """Yield the number and result of each job, in the order in which they finish.

    A result is what `function(*job, report)` returns.

    Args:
        pool: pool that runs the jobs.
        function: function at the top level of a module; it calls `report(share)` with the share of
            the job that is done, 0..1.
        jobs: arguments of each call.
        show: function called with the share of all jobs that is done, 0..1.
        sizes: amount of work of each job, in any unit; None for equal jobs.

    Raises:
        KilledProcessError: a process was killed, for example because memory ran out.
        Exception: a job failed.
    """
    weights = np.ones(len(jobs)) if sizes is None else np.asarray(sizes, np.float64)
    weights, shares = weights / weights.sum(), np.zeros(len(jobs))
    places = {pool.submit(function, *job): index for index, job in enumerate(jobs)}

    def show_shares() -> None:
        for number, index in places.items():
            shares[index] = pool.shares.get(number, 0.0)
        show(float(weights @ shares))

    if isinstance(pool, ThisProcess):
        pool.show = show_shares
    while places:
        for number, result in pool.finished(LOOK_S):
            index = places.pop(number)
            yield index, result
            shares[index] = 1.0
        show_shares()


@contextmanager
def hidden_script() -> Iterator[None]:
    """Start processes that do not run the user's script again.

    Spawned processes import the `__main__` module: a script without a guard would drive again in
    each of them. The jobs need nothing from it.
    """
    script = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = script


def _begin(parent: int, reports: Any) -> None:
    """Prepare a process of a pool, which ends when its parent has ended."""
    global _reports
    _reports = reports
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_after(parent)


def _run(number: int, job: bytes) -> Any:
    """Run a pickled job in a process of a pool; send at most five shares a second."""
    function, arguments = pickle.loads(job)  # of the process that started this one
    next_s = 0.0

    def report(share: float) -> None:
        nonlocal next_s
        if time.monotonic() >= next_s:
            next_s = time.monotonic() + LOOK_S
            _reports.put((number, share))

    result = function(*arguments, report)
    sys.stdout.flush()  # now, because the parent kills this process in the end
    return result


def read_apart(read: Callable[..., Result], path: Path, *arguments: Any) -> Result:
    """Return `read(path, *arguments)`, a function at the top level of a module.

    It runs in a process of its own, within a time and a memory for the file's size. Libraries in C
    crash on some damaged files, and never return from others or take all memory. Then Ctrl-C does
    not reach Python either.

    Raises:
        InputError: as `read`; or the process crashed, or took too long or too much memory.
    """
    size = path.stat().st_size if path.is_file() else 0
    most_s, most_bytes = READ_S + size / BYTES_PER_S, FREE_BYTES + COPIES * size
    too_large = f"takes more than {most_bytes / 1e6:,.0f} MB"
    reason, last_s = f"does not end within {most_s:.0f} s", time.monotonic() + most_s
    with ProcessPool(1) as pool:
        pool.submit(_read, read, path, arguments, most_bytes)
        try:
            while time.monotonic() < last_s:
                for _, result in pool.finished(LOOK_S):
                    return result
                if pool.used_bytes() > most_bytes:  # where the system sets no limit
                    raise MemoryError
        except MemoryError:
            reason = too_large
        except KilledProcessError:
            reason = "ends its process"
    raise InputError(
        f"{path}: is damaged, or made to do harm: reading it {reason}; copy it again, or name "
        "another file"
    )


def _read(read: Callable, path: Path, arguments: tuple, most_bytes: int, _report: object) -> Any:
    limit_resource("RLIMIT_DATA", most_bytes)
    return read(path, *arguments)

"""Processes that run jobs in parallel, and end when this process ends, however it ends."""

import multiprocessing
import os
import pickle
import queue
import signal
import sys
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from types import ModuleType
from typing import Any, Protocol, TypeVar

import numpy as np

from zoo.base.cores import usable_cores
from zoo.base.errors import InputError

Result = TypeVar("Result")
LOOK_S = 0.2  # seconds between two updates of the progress


class KilledProcessError(InputError):
    """A process of a pool was killed, for example because memory ran out."""


class RemoteTracebackError(Exception):
    """The cause of an error of a job: its traceback in the process of the pool."""


@dataclass
class _Worker:
    """A process of a pool, the parent's end of its pipe, and its job's number; None if idle."""

    process: BaseProcess
    pipe: Connection
    job: int | None = None


class ProcessPool:
    """Processes that run jobs.

    Each process waits for the end of its pipe, which is closed at the end of the `with` block and
    when this process is killed. Ctrl-C does not reach the processes: this one ends them. The
    executor of `concurrent.futures` instead waits for running jobs, and its processes outlive a
    killed parent.

    Args:
        processes: number of processes.
        key: key of the command that sets the number, for messages.
    """

    def __init__(self, processes: int, key: str = "workers") -> None:
        self.processes, self.key = processes, key
        self.shares: dict[int, float] = {}  # finished share of running jobs, 0..1
        self._workers: list[_Worker] = []
        self._queue: deque[tuple[int, bytes]] = deque()
        self._submitted = 0

    def __enter__(self) -> "ProcessPool":
        # Spawned: PyTorch's and Panda3D's threads do not survive a fork.
        context = multiprocessing.get_context("spawn")
        with _hidden_script(), _held_interrupt():
            for _ in range(self.processes):
                pipe, theirs = context.Pipe()
                process = context.Process(target=_serve, args=(theirs,), daemon=True)
                process.start()
                theirs.close()
                self._workers.append(_Worker(process, pipe))
        return self

    def __exit__(self, *error: object) -> None:
        self.end()

    def end(self) -> None:
        """End the processes at once."""
        for one in self._workers:
            one.pipe.close()
            one.process.kill()  # its jobs are done, or of no use
        for one in self._workers:
            one.process.join()

    def submit(self, function: Callable, *arguments: object) -> int:
        """Queue `function(*arguments, report)`, and return the job's number.

        Args:
            function: function at the top level of a module; it may call `report(share)` with the
                share of the job that is done, 0..1.
            arguments: arguments that can be pickled.
        """
        self._queue.append((self._submitted, pickle.dumps((function, arguments))))
        self._submitted += 1
        self._hand_out()
        return self._submitted - 1

    def finished(self, wait_s: float) -> list[tuple[int, Any]]:
        """Return the numbers and results of jobs that have finished, and hand out waiting jobs.

        Args:
            wait_s: seconds to wait for the first.

        Raises:
            KilledProcessError: a process was killed.
            Exception: a job failed.
        """
        found = []
        ready = wait([one.pipe for one in self._workers], wait_s)
        for one in self._workers:
            if one.pipe not in ready:
                continue
            try:
                kind, value = one.pipe.recv()
            except (EOFError, OSError):
                raise self._killed() from None
            assert one.job is not None
            if kind == "share":
                self.shares[one.job] = value
                continue
            self.shares.pop(one.job, None)
            if kind == "error":
                error, trace = value
                raise error from RemoteTracebackError(trace)
            found.append((one.job, value))
            one.job = None
        self._hand_out()
        return found

    def _hand_out(self) -> None:
        for one in self._workers:
            if one.job is None and self._queue:
                one.job, job = self._queue.popleft()
                try:
                    one.pipe.send_bytes(job)
                except OSError:
                    raise self._killed() from None

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
    """Open a pool for several calls of `run_jobs`; a pool of one process is this one.

    Args:
        workers: number of processes; 0 for one per core.
        most: largest number of processes.
    """
    processes = min(workers or usable_cores(), most)
    if processes <= 1:
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
    places = {pool.submit(function, *job): place for place, job in enumerate(jobs)}

    def show_shares() -> None:
        for number, place in places.items():
            shares[place] = pool.shares.get(number, 0.0)
        show(float(weights @ shares))

    if isinstance(pool, ThisProcess):
        pool.show = show_shares
    while places:
        for number, result in pool.finished(LOOK_S):
            place = places.pop(number)
            yield place, result
            shares[place] = 1.0
        show_shares()


@contextmanager
def _hidden_script() -> Iterator[None]:
    """Start processes that do not run the user's script again.

    Spawned processes import the `__main__` module: a script without `if __name__ == "__main__":`
    would drive again in each of them. The jobs need nothing from it.
    """
    script = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = script


@contextmanager
def _held_interrupt() -> Iterator[None]:
    """Start processes that Ctrl-C does not reach; deliver one that arrives meanwhile at the end."""
    asked: list[int] = []
    is_main = threading.current_thread() is threading.main_thread()
    if is_main:
        before = signal.signal(signal.SIGINT, lambda *_: asked.append(1))
    if hasattr(signal, "pthread_sigmask"):  # a new process inherits the mask
        resource_tracker.ensure_running()  # else its start clears the mask
        block = signal.SIG_BLOCK  # type: ignore[attr-defined,unused-ignore]
        mask = signal.pthread_sigmask(block, [signal.SIGINT])
    try:
        yield
    finally:
        if hasattr(signal, "pthread_sigmask"):
            back = signal.SIG_SETMASK  # type: ignore[attr-defined,unused-ignore]
            signal.pthread_sigmask(back, mask)
        if is_main:
            signal.signal(signal.SIGINT, before)
    if asked:
        signal.raise_signal(signal.SIGINT)


def _serve(pipe: Connection) -> None:
    """Run jobs in a process of the pool until the pipe ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    jobs: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    threading.Thread(target=_receive, args=(pipe, jobs), daemon=True).start()
    with suppress(OSError):  # the parent has ended, which the thread notices, too
        while True:
            answer = _answer(jobs.get(), _Report(pipe))
            sys.stdout.flush()  # now, because the parent kills this process in the end
            pipe.send(answer)


def _receive(pipe: Connection, jobs: "queue.SimpleQueue[bytes]") -> None:
    """Queue what arrives; at the end of the pipe, end this process, whatever it is doing."""
    try:
        while True:
            jobs.put(pipe.recv_bytes())
    finally:
        os._exit(1)


class _Report:
    """The `report(share)` of a job, which sends at most five shares a second."""

    def __init__(self, pipe: Connection) -> None:
        self._pipe, self._next_s = pipe, 0.0

    def __call__(self, share: float) -> None:
        if time.monotonic() >= self._next_s:
            self._next_s = time.monotonic() + LOOK_S
            self._pipe.send(("share", share))


def _answer(job: bytes, report: _Report) -> tuple[str, Any]:
    """Return the kind and value of a job's answer: its result, or its error and traceback."""
    try:
        function, arguments = pickle.loads(job)
        return "result", function(*arguments, report)
    except BaseException as error:
        trace = traceback.format_exc()
        try:
            pickle.loads(pickle.dumps(error))
        except Exception:
            return "error", (RuntimeError(f"{type(error).__name__}: {error}"), trace)
        return "error", (error, trace)

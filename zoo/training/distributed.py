"""Processes that train together (`trainer=ddp_cpu`): when one ends, end the others."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import lightning
import torch

from zoo.base.errors import InputError, PrunedError, StoppedError
from zoo.base.terminal import error_line
from zoo.runs.status import read_status, write_status
from zoo.training.run_module import callbacks_of

# A process that waits in a collective operation may or may not learn that another one ended.
LOOK_S, GRACE_S = 0.5, 15.0


@contextmanager
def ending_together(trainer: lightning.Trainer, folder: Path, command: str) -> Iterator[None]:
    """Turn an error of any process into one of the first process, which alone prints it.

    Args:
        trainer: Lightning's trainer.
        folder: run's folder.
        command: command that resumes the run.

    Raises:
        InputError: another process failed or was killed; the message holds its reason.
        SystemExit: in a process that is not the first, in place of any error.
    """
    if trainer.world_size == 1:
        yield
        return
    watch = Watch(folder, command)
    callbacks_of(trainer).append(watch)
    try:
        yield
    except Exception as error:
        watch.over.set()
        if not trainer.is_global_zero:
            if isinstance(error, InputError | StoppedError):  # for the first process to read
                write_status(folder, "failed", reason=str(error))
            elif not (is_lost_connection(error) or isinstance(error, PrunedError)):
                raise  # a bug, not a user's mistake: keep its traceback
            sys.exit(0)
        reason = watch.reason(wait_s=3.0) if is_lost_connection(error) else None
        if reason:
            raise InputError(reason) from error
        raise
    finally:
        watch.end()


class Watch(lightning.Callback):
    """A thread that checks whether the other processes still run.

    A process that waits for one that has ended gets an error from gloo at once, but none from NCCL
    for minutes. Lightning's own watch kills the first process before it can print why.
    """

    def __init__(self, folder: Path, command: str) -> None:
        self.folder, self.command = folder, command
        self.others: list[subprocess.Popen] = []
        self.over = threading.Event()

    def setup(self, trainer: lightning.Trainer, module: object, stage: str) -> None:
        """Start the thread."""
        if self.over.is_set():
            return
        if trainer.is_global_zero:
            from lightning.fabric.strategies.launchers.subprocess_script import (
                _ChildProcessObserver,
            )

            self.others = list(getattr(trainer.strategy.launcher, "procs", []))
            for thread in threading.enumerate():
                if isinstance(thread, _ChildProcessObserver):
                    thread._child_processes = []  # Lightning then ignores them
            self._start(self._failed_other)
        elif os.environ.get("LOCAL_RANK", "0") != "0":
            parent = os.getppid()
            self._start(lambda: os.getppid() != parent)

    def reason(self, wait_s: float = 0.0) -> str | None:
        """Return why another process failed; None where none did."""
        until = time.monotonic() + wait_s
        while True:
            status = read_status(self.folder)
            if status.get("status") == "failed":
                return status.get("reason")
            if self._failed_other() or time.monotonic() > until:
                break
            time.sleep(0.1)
        for number, process in enumerate(self.others, 1):
            code = process.poll()
            if code:
                how = signal.Signals(-code).name if code < 0 else f"exit status {code}"
                return (
                    f"process {number + 1} of the {len(self.others) + 1} that train together ended "
                    f"({how}); complete epochs are saved; resume with: {self.command}"
                )
        return None

    def end(self) -> None:
        """Stop the thread, and end the other processes after an error."""
        self.over.set()
        failed = sys.exc_info()[0] is not None
        for process in self.others if failed else []:
            try:
                process.wait(2.0)
            except subprocess.TimeoutExpired:
                process.kill()

    def _failed_other(self) -> bool:
        return any(process.poll() for process in self.others)

    def _start(self, is_over: Callable[[], bool]) -> None:
        threading.Thread(target=self._look, args=(is_over,), daemon=True).start()

    def _look(self, is_over: Callable[[], bool]) -> None:
        while not self.over.wait(LOOK_S):
            if not is_over() or self.over.wait(GRACE_S):
                continue
            reason = self.reason()
            if self.others and reason:
                write_status(self.folder, "failed", reason=reason)
                print(error_line("zoo", reason), file=sys.stderr, flush=True)
            for process in self.others:
                process.kill()
            os._exit(1)  # the main thread waits forever in a collective operation


def is_lost_connection(error: Exception) -> bool:
    """Return whether another process ended during a collective operation."""
    return isinstance(error, torch.distributed.DistError) or (
        isinstance(error, RuntimeError) and "gloo" in str(error)
    )

"""Clusters that run the jobs of `zoo.base.process_pool`: Ray, and Slurm through submitit.

All nodes need the same files. Ray's address is that of RAY_ADDRESS, or this machine alone; Slurm's
partition and account are those of SBATCH_PARTITION and SBATCH_ACCOUNT.
"""

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from zoo.base.errors import InputError, optional_import
from zoo.base.parts import VARIABLE

Place = tuple[str, list[str], str]
LOGS = Path("outputs") / "slurm"


def this_place() -> Place:
    """Return what a task needs to run as here: the folder, the import path and the parts."""
    return str(Path.cwd()), sys.path, os.environ.get(VARIABLE, "")


def enter_place(place: Place) -> None:
    """Take the folder, the import path and the parts of another process."""
    folder, paths, os.environ[VARIABLE] = place
    os.chdir(folder)
    sys.path[:] = [*paths, *(path for path in sys.path if path not in paths)]


@contextmanager
def running_ray(key: str, **settings: Any) -> Iterator[None]:
    """Connect to Ray, or start it on this machine, unless it runs in this process already.

    Args:
        key: what the user set, for messages.
        **settings: arguments of `ray.init`.

    Raises:
        InputError: Ray is not installed, cannot start, or finds no cluster at the address.
    """
    with optional_import(f'{key}: Ray is not installed; pip install "drivezoo[ray]"'):
        import ray
    started = not ray.is_initialized()
    try:
        if started:
            ray.init(**{"logging_level": "warning", "configure_logging": True, **settings})
    except (ConnectionError, ValueError, RuntimeError) as error:
        raise InputError(f"{key}: {error}") from None
    try:
        yield
    finally:
        if started:
            ray.shutdown()


class ClusterPool:
    """Jobs as tasks of a cluster, with the methods of `zoo.base.process_pool.ProcessPool`.

    Args:
        start: function of a job's function, its arguments and a `Place` that starts a task, and
            returns an object with the methods `done` and `result`.
    """

    def __init__(self, start: Callable[..., Any]) -> None:
        self.shares: dict[int, float] = {}  # a task reports none
        self._start, self._submitted = start, 0
        self._running: dict[int, Any] = {}

    def submit(self, function: Callable, *arguments: object) -> int:
        """Start a job, and return its number."""
        self._running[self._submitted] = self._start(_run_job, function, arguments, this_place())
        self._submitted += 1
        return self._submitted - 1

    def finished(self, wait_s: float) -> list[tuple[int, Any]]:
        """Return the numbers and results of jobs that have finished.

        Raises:
            InputError: a job failed by the user's input.
            Exception: a task failed otherwise, or its process died.
        """
        time.sleep(wait_s)
        finished = []
        for number in [number for number, task in self._running.items() if task.done()]:
            value, error = self._running.pop(number).result()
            if error is not None:
                raise error
            finished.append((number, value))
        return finished


@contextmanager
def opened_ray() -> Iterator[ClusterPool]:
    """Open the pool of a Ray cluster.

    Raises:
        InputError: Ray is not installed, or the cluster cannot be reached.
    """
    address = os.environ.get("RAY_ADDRESS")
    with running_ray("executor=ray", address=address, log_to_driver=False):
        import ray

        def start(function: Callable, *arguments: object) -> Any:
            return ray.remote(num_cpus=1, max_retries=0)(function).remote(*arguments).future()

        yield ClusterPool(start)


@contextmanager
def opened_slurm() -> Iterator[ClusterPool]:
    """Open the pool of a Slurm cluster.

    Raises:
        InputError: submitit is not installed.
    """
    line = 'executor=slurm: submitit is not installed; pip install "drivezoo[slurm]"'
    with optional_import(line):
        import submitit
    slurm = submitit.AutoExecutor(LOGS, cluster="slurm")
    slurm.update_parameters(name="drivezoo", timeout_min=720, cpus_per_task=1, mem_gb=4)
    yield ClusterPool(slurm.submit)


def _run_job(function: Callable, arguments: tuple, place: Place) -> tuple[Any, InputError | None]:
    """Run a job in a process of the cluster; return its result, or the user's mistake."""
    enter_place(place)
    try:
        return function(*arguments, lambda share: None), None
    except InputError as error:
        return None, error

"""The only code that opens worlds, sets threads, starts processes and closes: many drives."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from rich.console import Console

from datamodules.view import FRAME
from zoo.base.console_progress import progress_bar
from zoo.base.entry_points import load_named
from zoo.base.errors import InputError
from zoo.base.process_pool import (
    EXECUTORS,
    PROCESSES,
    Pool,
    ThisProcess,
    opened_pool,
    run_jobs,
)
from zoo.base.rig import UDACITY
from zoo.checkpoints.policy_base import Policy
from zoo.driving.drive_loop import drive
from zoo.driving.drive_record import Drive, DriveRow
from zoo.driving.open_world import open_world
from zoo.driving.scenario import Scenario
from zoo.driving.speed_controller import SpeedController
from zoo.driving.world import World


class PolicyMaker(ABC):
    """What makes the policy of a drive, in the process and the world in which it drives."""

    @abstractmethod
    def policy(self, world: Any, scenario: Scenario) -> Policy:
        """Return the policy in a world, of the kind that the scenarios name."""


class Keep:
    """What is kept of a drive, in the process that drives; this class keeps the drive itself.

    It is entered before the drive, and left after it.
    """

    def begin(self, world: World) -> None:
        """Take the world of the drive, before its first frame."""

    def __enter__(self) -> Any:
        return self

    def __exit__(self, *error: object) -> None:
        pass

    def show(self, frame: Any, row: DriveRow) -> bool | None:
        """Take the next frame, uint8 [H, W, 3] RGB, and its row; True ends the drive.

        The frame is None in a world without a renderer.
        """
        return None

    def result(self, drive: Drive, policy: Any, world: Any) -> Any:
        """Return what is kept, after the drive and before the world is closed.

        The policy and the world are of the kinds that the driver and the scenario name.
        """
        return drive


# Path of a checkpoint, a policy, or what makes one.
Driver: TypeAlias = str | Policy | PolicyMaker


def run_drives(
    drivers: Driver | Sequence[Driver],
    scenarios: Sequence[Scenario],
    keep: Keep | Sequence[Keep] | None = None,
    workers: int = 1,
    what: str = "",
    console: Console | None = None,
    renderer: str = "auto",
    first_only: bool | Sequence[bool] = False,
    world: World | None = None,
    pool: Pool | None = None,
    executor: str = PROCESSES,
    speeds: Sequence[SpeedController | None] | None = None,
) -> Iterator[tuple[int, Any]]:
    """Drive scenarios, in parallel; yield number and result of each drive as soon as it ends.

    The figures do not depend on the number of processes.

    Args:
        drivers: what drives all scenarios, or each of them: the path of a checkpoint, a policy,
            which drives in this process, or what makes a policy.
        scenarios: what to drive.
        keep: what each drive results in, one for all drives or one for each; None for the `Drive`.
        workers: number of processes; 0 for one per core.
        what: text beside the progress; empty shows none.
        console: console that shows the progress.
        renderer: auto, software (the same frames on all machines) or none.
        first_only: whether drives end at their first intervention, one for all or one for each.
        world: open world to drive in, in this process, which is not closed; None opens one for each
            drive.
        pool: open pool of processes, in place of `workers`.
        executor: processes of this machine, or an entry point of the group `drivezoo.executors`:
            a function that opens a pool, such as that of a cluster.
        speeds: speed controller of each drive; None for that of its scenario.

    Raises:
        InputError: a world or a policy cannot be opened; or a process was killed, for example
            because memory ran out.
    """
    each_driver = [drivers] * len(scenarios) if isinstance(drivers, Driver) else list(drivers)
    keeps = [keep or Keep()] * len(scenarios) if not isinstance(keep, Sequence) else list(keep)
    firsts = [first_only] * len(scenarios) if isinstance(first_only, bool) else first_only
    parts = zip(each_driver, scenarios, keeps, speeds or [None] * len(firsts), firsts, strict=True)
    jobs = [(*part, renderer, world) for part in parts]
    if world is not None or any(isinstance(driver, Policy) for driver in each_driver):
        pool = ThisProcess()  # a policy or a world may not fit through a pipe
    with ExitStack() as stack:
        if pool is None:
            if executor == PROCESSES:
                opened = opened_pool(workers, most=len(jobs))
            else:
                opened = load_named(EXECUTORS, executor, Callable, "executor=", (PROCESSES,))()
            pool = stack.enter_context(opened)
        shown: dict[str, Any] = {}
        if what and console is not None:
            shown["show"] = stack.enter_context(progress_bar(what, console))
        yield from run_jobs(pool, _drive_once, jobs, **shown)


def all_drives(*arguments: Any, **keywords: Any) -> list[Any]:
    """Return the results of `run_drives` in the order of the scenarios."""
    return [result for _, result in sorted(run_drives(*arguments, **keywords))]


def check_throttle(policy: Policy, throttle: str) -> None:
    """Check that a network predicts a throttle if it shall control the throttle.

    Raises:
        InputError: `throttle` is `network`, and the network predicts none.
    """
    if throttle != "network":
        return
    # In any car: only the throttle is asked for.
    if policy.in_car(UDACITY)(np.zeros((*FRAME, 3), np.uint8), 0.0).throttle is None:
        raise InputError(
            "throttle=network: this network predicts no throttle; train model=nvidia_speed, or use "
            "throttle=hold"
        )


@contextmanager
def one_thread() -> Iterator[None]:
    """Let torch compute in one thread: a frame is too little work for two."""
    import torch

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        if threads > 1:  # a thread that starts during another one's drive finds 1
            torch.set_num_threads(threads)


def _drive_once(
    driver: Driver,
    scenario: Scenario,
    keep: Keep,
    speed: SpeedController | None,
    first_only: bool,
    renderer: str,
    world: World | None,
    report: Callable[[float], None],
) -> Any:
    """Drive once in this process."""
    with one_thread(), ExitStack() as stack:
        if world is None:
            world = open_world(scenario, renderer)
            stack.callback(world.close)
        policy = _policy(driver, world, scenario, speed is None)
        with keep:
            keep.begin(world)
            driven = drive(policy, world, scenario, keep.show, report, first_only, speed)
            return keep.result(driven, policy, world)


def _policy(driver: Driver, world: World, scenario: Scenario, own_speed: bool) -> Policy:
    """Return what drives; without a controller of its own, the scenario's throttle is checked."""
    if isinstance(driver, PolicyMaker):
        return driver.policy(world, scenario)
    policy = (load_kept(driver) if isinstance(driver, str) else driver).scored()
    if own_speed:
        check_throttle(policy, scenario.throttle)
    return policy


def load_kept(path: str) -> Policy:
    """Return the policy of a file, which is loaded again only if another file drove since."""
    status = Path(path).stat() if Path(path).exists() else None
    return _load(path, status and (status.st_ino, status.st_mtime_ns, status.st_size))


@lru_cache(maxsize=1)  # a process mostly drives one checkpoint
def _load(path: str, version: tuple[int, int, int] | None) -> Policy:
    from zoo.checkpoints.checkpoint_policy import load_policy

    return load_policy(path)

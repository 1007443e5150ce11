"""Drives with a guard, and without one at the same mean speed."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from zoo.base.process_pool import drive_in_processes
from zoo.drives.metrics import measure
from zoo.evaluate.many_drives import Setup, drive_setup, open_setup
from zoo.guard.conditions import Condition, conditioned_policy
from zoo.guard.observed_drive import one_thread
from zoo.monitor.guard_file import read_guard
from zoo.monitor.guarded_policy import GuardedPolicy

LEAST_MPH = 4.0  # a drive ends when its mean speed is below 3 mph


@dataclass(frozen=True)
class Driven:
    """Figures of a drive.

    Attributes:
        interventions: number of interventions.
        driven_m: distance driven in metres.
        speed_mph: mean speed in mph.
        alarms: how often the guard began to fire; 0 without a guard.
    """

    interventions: int
    driven_m: float
    speed_mph: float
    alarms: int = 0


def drive_guarded(
    checkpoint: str,
    guard: str | None,
    noise: float,
    setup: Setup,
    report: Callable[[float], None] | None = None,
) -> Driven:
    """Drive once in this process and return the figures.

    Args:
        checkpoint: checkpoint file.
        guard: guard file; None drives without one.
        noise: see `Condition`; 0 leaves the network as it is.
        setup: setup of the drive.
        report: function called at every frame with the share of the drive that is done, 0..1.
    """
    world = open_setup(setup, "auto")
    with one_thread():
        policy = conditioned_policy(checkpoint, noise, setup.seed)
        if guard is not None:
            policy = GuardedPolicy(policy, read_guard(guard))
        drive = drive_setup(policy, world, setup, None, report)
    world.pictures.close()
    figures = measure(drive)
    return Driven(
        int(figures["interventions"]),
        figures["driven_m"],
        figures["speed_mph"],
        0 if guard is None else policy.alarms,
    )


def drive_pairs(
    checkpoint: str,
    guard: str,
    conditions: Sequence[Condition],
    workers: int,
    show: Callable[[float], None],
) -> tuple[list[Driven], list[Driven]]:
    """Drive conditions with a guard, then without one at the mean speed of the guarded drive.

    A slower car fails less often, with or without warnings; the second drive shows how much of the
    effect is the speed alone.

    Args:
        checkpoint: checkpoint file.
        guard: guard file.
        conditions: conditions to drive.
        workers: number of processes; 0 for one per core.
        show: function called with the share of the drives that is done, 0..1.
    """
    jobs = [(checkpoint, guard, one.noise, one.setup) for one in conditions]
    with_guard = _drive(jobs, workers, lambda share: show(share / 2))
    slower = []
    for one, driven in zip(conditions, with_guard, strict=True):
        setup = replace(one.setup, speed_mph=max(driven.speed_mph, LEAST_MPH))
        slower.append((checkpoint, None, one.noise, setup))
    return with_guard, _drive(slower, workers, lambda share: show(0.5 + share / 2))


def _drive(jobs: list[tuple], workers: int, show: Callable[[float], None]) -> list[Driven]:
    found = dict(drive_in_processes(drive_guarded, jobs, workers, show))
    return [found[number] for number in range(len(jobs))]

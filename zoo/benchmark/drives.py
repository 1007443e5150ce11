"""The drives of an entry in parallel processes, with the figures and the digest of each."""

import hashlib
import math
from collections.abc import Callable, Sequence

import numpy as np
from rich.console import Console

from simulator.track_file import read_track
from zoo.base.process_pool import drive_in_processes
from zoo.benchmark.drivers import Driver, needs_frames, steering_of
from zoo.benchmark.finished_drives import FinishedDrives
from zoo.benchmark.result import DriveRecord
from zoo.benchmark.suite import LAPS, Suite, SuiteDrive
from zoo.cli.console_progress import progress_bar
from zoo.drives.drive_record import Drive
from zoo.drives.metrics import measure
from zoo.evaluate.many_drives import Setup, drive_setup, open_setup

MACHINE = ("latency_ms",)  # metrics that depend on the machine
DECIMALS = 6  # of the rows in a digest


def drive_suite(
    drivers: Sequence[Driver],
    suite: Suite,
    finished: FinishedDrives,
    workers: int,
    console: Console,
) -> list[DriveRecord]:
    """Drive every drive of a suite with every driver.

    Args:
        drivers: drivers of the entry.
        suite: suite to drive.
        finished: drives that are not repeated; each further one is added.
        workers: number of processes; 0 for one per core. It does not change the figures.
        console: console that shows the progress.

    Raises:
        InputError: the simulator cannot be opened, or a process was killed.
    """
    jobs = [(number, one) for number in range(len(drivers)) for one in suite.drives]
    return drive_jobs(drivers, jobs, suite.mean_steering, workers, console, finished)


def drive_jobs(
    drivers: Sequence[Driver],
    jobs: Sequence[tuple[int, SuiteDrive]],
    mean_steering: float | None,
    workers: int,
    console: Console,
    finished: FinishedDrives | None = None,
) -> list[DriveRecord]:
    """Return the drives of some drivers, each named by its number, in the order of the jobs."""
    drives = {} if finished is None else dict(finished.drives)
    # Laps take longest: begun last, they would leave the other processes without work.
    order = sorted(set(range(len(jobs))) - set(drives), key=lambda one: jobs[one][1].group != LAPS)
    arguments = [
        (drivers[jobs[number][0]].file, jobs[number][1].setup, mean_steering) for number in order
    ]
    frames = expected_frames([jobs[number][1].setup for number in order])
    with progress_bar(f"driving {len(order)} roads", console) as show:
        for place, result in drive_in_processes(drive_road, arguments, workers, show, frames):
            driver, one = jobs[order[place]]
            drives[order[place]] = DriveRecord(
                checkpoint=driver,
                group=one.group,
                track=one.track,
                settings=one.settings,
                figures=result[0],
                digest=result[1],
            )
            if finished is not None:
                finished.add(order[place], drives[order[place]])
    return [drives[number] for number in range(len(jobs))]


def expected_frames(setups: Sequence[Setup]) -> list[float]:
    """Return about how many frames each drive has, for the time left: laps have most."""
    lengths = {track: read_track(track).length for track in {one.track for one in setups}}
    return [
        lengths[one.track] * one.laps * one.frame_rate / max(one.speed_mph, 1.0) for one in setups
    ]


def drive_road(
    file: str,
    setup: Setup,
    mean_steering: float | None,
    report: Callable[[float], None] | None = None,
) -> tuple[dict[str, float | None], str]:
    """Drive one road in this process; return figures and digest.

    Args:
        file: path of the checkpoint, or name of the baseline.
        setup: setup of the drive.
        mean_steering: see `steering_of`.
        report: function called at every frame with the share of the drive that is done, 0..1.
    """
    import torch

    threads = torch.get_num_threads()
    torch.set_num_threads(1)  # one frame is too little work for two threads
    # Other renderers draw other frames: the digest would depend on the machine.
    world = open_setup(setup, "software" if needs_frames(file) else "none")
    try:
        drive = drive_setup(steering_of(file, world, mean_steering), world, setup, None, report)
    finally:
        torch.set_num_threads(threads)
        if world.pictures is not None:
            world.pictures.close()
    figures = measure(drive)
    if drive.nan_frames:
        figures["nan_frames"] = drive.nan_frames
    return {
        name: value if math.isfinite(value) else None
        for name, value in figures.items()
        if name not in MACHINE
    }, drive_digest(drive)


def drive_digest(drive: Drive) -> str:
    """Return 16 hexadecimal digits of a drive's rows; neither latency nor wall time is in it."""
    columns = (
        drive.steering,
        drive.throttle,
        drive.speed_mph,
        drive.cross_track_m,
        drive.intervention,
    )
    rows = np.stack([np.asarray(one, np.float64) for one in columns], -1)
    rounded = np.round(rows, DECIMALS) + 0.0  # no negative zeros
    return hashlib.sha256(rounded.astype("<f8").tobytes()).hexdigest()[:16]

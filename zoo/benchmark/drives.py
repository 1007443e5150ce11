"""The drives of an entry in parallel processes, with the figures and the digest of each."""

import hashlib
import math
from collections.abc import Sequence

import numpy as np
from rich.console import Console

from zoo.benchmark.baselines import BASELINES
from zoo.benchmark.drivers import Baseline, Driver
from zoo.benchmark.finished_drives import FinishedDrives
from zoo.benchmark.result import DriveRecord
from zoo.benchmark.suite import LAPS, SuiteDrive
from zoo.drives.drive_record import Drive
from zoo.drives.metrics import measure
from zoo.worlds.run_drives import run_drives

MACHINE = ("latency_ms",)  # metrics that depend on the machine
DECIMALS = 6  # of the rows in a digest


def drive_suite(
    drivers: Sequence[Driver],
    jobs: Sequence[tuple[int, SuiteDrive]],
    mean_steering: float | None,
    workers: int,
    console: Console,
    finished: FinishedDrives | None = None,
) -> list[DriveRecord]:
    """Return the drives of some drivers, in the order of the jobs.

    Args:
        drivers: drivers of the entry.
        jobs: number of a driver, and drive of a suite.
        mean_steering: steering of the baseline `mean`, -1..1.
        workers: number of processes; 0 for one per core. It does not change the figures.
        console: console that shows the progress.
        finished: drives that are not repeated; each further one is added.

    Raises:
        InputError: the simulator cannot be opened, or a process was killed.
    """
    drives = {} if finished is None else dict(finished.drives)
    # Laps take longest: begun last, they would leave the other processes without work.
    order = sorted(set(range(len(jobs))) - set(drives), key=lambda one: jobs[one][1].group != LAPS)
    files = [drivers[jobs[number][0]].file for number in order]
    is_baseline = bool(files) and files[0] in BASELINES
    for place, drive in run_drives(
        [Baseline(one, mean_steering) if is_baseline else one for one in files],
        [jobs[number][1].scenario for number in order],
        workers=workers,
        what=f"driving {len(order)} roads",
        console=console,
        # Other renderers draw other frames: the digest would depend on the machine.
        renderer="none" if is_baseline else "software",
    ):
        driver, one = jobs[order[place]]
        drives[order[place]] = DriveRecord(
            checkpoint=driver,
            group=one.group,
            track=one.track,
            settings=one.settings,
            figures=drive_figures(drive),
            digest=drive_digest(drive),
        )
        if finished is not None:
            finished.add(order[place], drives[order[place]])
    return [drives[number] for number in range(len(jobs))]


def drive_figures(drive: Drive) -> dict[str, float | None]:
    """Return the figures of a drive that do not depend on the machine."""
    figures = measure(drive)
    if drive.nan_frames:
        figures["nan_frames"] = drive.nan_frames
    return {
        name: value if math.isfinite(value) else None
        for name, value in figures.items()
        if name not in MACHINE
    }


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

"""Drives that end at their first intervention, in several processes."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import torch

from simulator.pictures import open_pictures
from simulator.track import Track
from simulator.track_content import make_track
from simulator.weather import Weather
from simulator.world import Start, World
from zoo.base.process_pool import opened_runner
from zoo.checkpoints.policy import load_policy
from zoo.drives.drive_record import Drive
from zoo.evaluate.embedded_drive import drive_closed_loop
from zoo.evaluate.many_drives import speed_controller

BATCH = 8  # drives that are chosen together, for every number of processes
TRACK = "mildest"  # name of every road, as of the file that replays one


@dataclass(frozen=True)
class Job:
    """One drive of a search.

    Attributes:
        checkpoint: checkpoint file.
        content: content of the road's YAML file.
        weather: day of the drive.
        speed_mph: speed to hold.
        frame_rate, delay_s, quality: see `simulator.world_settings.WorldSettings`.
    """

    checkpoint: str
    content: dict[str, Any]
    weather: Weather
    speed_mph: float
    frame_rate: float
    delay_s: float
    quality: str


@dataclass(frozen=True)
class Outcome:
    """The end of a drive.

    Attributes:
        failed: whether it ended with an intervention.
        driven_m: metres driven.
        time_s: seconds driven.
        closeness: largest share of the way from the centreline to the edge line, below 1; 1 for
            a failure.
        nan_frames: number of frames for which the network steered NaN.
    """

    failed: bool
    driven_m: float
    time_s: float
    closeness: float
    nan_frames: int


DriveJobs = Callable[[Sequence[Job]], list[Outcome]]


def drive_job(job: Job, report: Callable[[float], None] | None = None) -> Outcome:
    """Drive until the first intervention, or to the end of the road; nothing is reported."""
    track = make_track(TRACK, job.content)
    drive = drive_to_failure(job, track)
    failed = bool(drive.intervention.any())
    edge = track.width_at(drive.distance_m) / 2
    closeness = float((np.abs(drive.cross_track_m) / edge).max())
    return Outcome(
        failed,
        round(drive.driven_m, 3),
        round(float(drive.time_s[-1]), 3),
        1.0 if failed else round(min(closeness, 0.999), 4),
        drive.nan_frames,
    )


def drive_to_failure(job: Job, track: Track) -> Drive:
    """Return the drive of a job on its road, as `zoo.evaluate` drives it with seed 0.

    Raises:
        InputError: no renderer can be opened.
    """
    threads = torch.get_num_threads()
    torch.set_num_threads(1)  # one frame is too little work for two threads
    pictures = open_pictures(track, "auto", job.quality)
    try:
        return drive_closed_loop(
            _policy(job.checkpoint),
            World(track, pictures, job.frame_rate, job.delay_s),
            speed_controller(job.speed_mph),
            seed=0,
            laps=1.0,
            weather=job.weather,
            start=Start(speed_mph=job.speed_mph),
            first_only=True,
        )
    finally:
        pictures.close()
        torch.set_num_threads(threads)


@contextmanager
def opened_drivers(workers: int) -> Iterator[DriveJobs]:
    """Open processes; yield a function that drives jobs and returns outcomes in their order.

    Args:
        workers: number of processes; 0 for one per core. At most 8 are opened.

    Raises:
        InputError: a process was killed, for example because memory ran out.
    """
    with opened_runner(workers, most=BATCH) as run:
        yield lambda jobs: [one for _, one in sorted(run(drive_job, [(job,) for job in jobs]))]


_policy = lru_cache(maxsize=1)(load_policy)

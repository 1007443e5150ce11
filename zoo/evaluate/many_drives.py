"""Many drives of a checkpoint in the embedded world, in parallel processes."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from rich.console import Console

from simulator.expert import Expert
from simulator.weather import CLEAR, Weather, read_weather
from simulator.world import World, open_world
from simulator.world_settings import WorldSettings
from zoo.base.errors import InputError
from zoo.base.process_pool import drive_in_processes
from zoo.checkpoints.command import PolicyFunction, call_policy, own_session
from zoo.cli.console_progress import progress_bar
from zoo.drives.drive_film import KeptFrames
from zoo.drives.drive_log import summarize, write_drive
from zoo.drives.drive_record import Drive, DriveRow
from zoo.drives.metrics import steering_per_s
from zoo.drives.speed_controller import PI, Network, SpeedController
from zoo.evaluate.drive_plots import birds_eye, error_over_distance
from zoo.evaluate.embedded_drive import drive_closed_loop, start_of
from zoo.evaluate.evaluate_options import EvaluateOptions
from zoo.runs.plots import save_figure


@dataclass(frozen=True)
class Setup(WorldSettings):
    """Everything besides the policy that the figures of a drive depend on.

    Attributes:
        track, seed, laps, speed_mph, margin_m, direction, frame_rate, delay_s, quality, throttle:
            see `EvaluateOptions`.
        weather: weather, or `random` for weather drawn from the seed.
        offset_m, heading_deg: shift and turn to the right, added to the start of the seed.
        film_speed: playing speed of the film as a multiple of the driven speed; 0 for no film.
            The figures do not depend on it.
        guard: path of the guard file that slows the car down; empty for none.
    """

    track: str
    seed: int = 0
    laps: float = 1.0
    speed_mph: float = 15.0
    margin_m: float | None = None
    weather: Weather | str = field(default=CLEAR, kw_only=True)
    offset_m: float = 0.0
    heading_deg: float = 0.0
    throttle: str = "hold"
    film_speed: float = 0.0
    guard: str = ""

    @property
    def start_mph(self) -> float:
        """Return the speed at the start: 0 for a network that controls the throttle."""
        return 0.0 if self.throttle == "network" else self.speed_mph

    @classmethod
    def of(cls, options: EvaluateOptions, track: str, seed: int) -> "Setup":
        """Return the setup of one drive from the options of an evaluation."""
        place = options.place | {"track": track, "weather": read_weather(options.weather)}
        return cls(
            **place,
            seed=seed,
            laps=options.laps,
            speed_mph=options.speed,
            margin_m=options.margin,
            throttle=options.throttle,
            film_speed=options.film_speed if options.film else 0.0,
            guard=options.guard or "",
        )


def speed_controller(speed_mph: float) -> PI:
    """Return the controller that holds the speed of scored drives: the Udacity course's."""
    return PI(speed_mph, kp=0.1, ki=0.002)


def check_throttle(policy: PolicyFunction, throttle: str) -> None:
    """Check that a network predicts a throttle if it shall control the throttle.

    Raises:
        InputError: `throttle` is `network`, and the network predicts none.
    """
    frame = np.zeros((160, 320, 3), np.uint8)
    if throttle == "network" and call_policy(policy, frame, 0.0).throttle is None:
        raise InputError(
            "throttle=network: this network predicts no throttle; train model=nvidia_speed, or use "
            "throttle=hold"
        )


def drive_all(
    checkpoint: str | Sequence[str] | PolicyFunction,
    setups: Sequence[Setup],
    folders: Sequence[Path | None],
    workers: int,
    console: Console,
) -> list[dict]:
    """Return the figures of each drive in the order of the setups.

    Args:
        checkpoint: checkpoint file for all drives, or one for each drive; or a policy, which drives
            in this process.
        setups: setup of each drive.
        folders: folder of each drive; None writes nothing.
        workers: number of processes; 0 for one per core. It does not change the figures.
        console: console that shows the progress.

    Raises:
        InputError: a process was killed, for example because memory ran out.
    """
    one_for_all = isinstance(checkpoint, str) or callable(checkpoint)
    drivers = [checkpoint] * len(setups) if one_for_all else checkpoint
    workers = 1 if callable(checkpoint) else workers  # a policy may not fit through a pipe
    jobs = list(zip(drivers, setups, folders, strict=True))
    laps = f"{setups[0].laps:g} lap{'' if setups[0].laps == 1 else 's'}"
    with progress_bar(f"driving {len(setups)} x {laps}", console) as show:
        found = dict(drive_in_processes(drive_once, jobs, workers, show))
    return [found[number] for number in range(len(setups))]


def drive_once(
    checkpoint: str | PolicyFunction,
    setup: Setup,
    folder: Path | None,
    report: Callable[[float], None] | None = None,
) -> dict[str, float | str | None]:
    """Drive once in this process and return the figures; a figure that is not finite is None.

    The figures hold `nan_frames` only if the policy steered NaN, and `guard_alarms` only if a guard
    watched: how often it began to slow the car down.

    Args:
        checkpoint: checkpoint file, or a policy.
        setup: setup of the drive.
        folder: folder for the drive, its plots and the frames of its worst moments; None writes
            nothing.
        report: function called at every frame with the share of the drive that is done, 0..1.
    """
    import torch

    from zoo.checkpoints.policy import load_policy
    from zoo.monitor.guarded_policy import guarded

    threads = torch.get_num_threads()
    torch.set_num_threads(1)  # one frame is too little work for two threads
    world = open_setup(setup, "auto")
    try:
        is_file = isinstance(checkpoint, str)
        policy = load_policy(checkpoint) if is_file else own_session(checkpoint)
        check_throttle(policy, setup.throttle)
        if setup.guard:
            policy = guarded(policy, checkpoint, setup.guard)
        with KeptFrames(folder, setup.frame_rate, setup.film_speed) as kept:
            drive = drive_setup(policy, world, setup, kept, report)
        drive = kept.write(drive)
    finally:
        torch.set_num_threads(threads)
    alarms = {"guard_alarms": policy.alarms} if setup.guard else {}
    figures = summarize(drive) | alarms
    if folder is not None:
        _leave(folder, world, drive, figures, alarms)
    world.pictures.close()
    return {
        key: None if isinstance(value, float) and not math.isfinite(value) else value
        for key, value in figures.items()
    }


def open_setup(setup: Setup, renderer: str) -> World:
    """Open the world of a setup.

    Raises:
        InputError: the world cannot be opened, for example without a renderer.
    """
    return open_world(renderer=renderer, **setup.place)


def drive_setup(
    policy: PolicyFunction,
    world: World,
    setup: Setup,
    show: Callable[[np.ndarray, DriveRow], None] | None = None,
    report: Callable[[float], None] | None = None,
) -> Drive:
    """Drive a policy once in an open world.

    Args:
        policy: see `drive_closed_loop`.
        world: world that `open_setup` opened.
        setup: setup of the drive.
        show: see `drive_closed_loop`.
        report: see `drive_closed_loop`.
    """
    speed: SpeedController = speed_controller(setup.speed_mph)
    if setup.throttle == "network":
        speed = Network()
    start = start_of(world, setup.seed, setup.start_mph)
    start = replace(
        start,
        cte=start.cte + setup.offset_m,
        heading_deg=start.heading_deg + setup.heading_deg,
    )
    return drive_closed_loop(
        policy,
        world,
        speed,
        setup.seed,
        setup.laps,
        setup.weather,
        setup.margin_m,
        start,
        show,
        report,
    )


def expert_steering_per_s(setup: Setup) -> float:
    """Return the expert's steering change per second on a lap at the setup's speed."""
    return _expert_steering_per_s(replace(setup, seed=0, laps=1.0, weather=CLEAR, margin_m=None))


@lru_cache
def _expert_steering_per_s(setup: Setup) -> float:
    world = open_setup(setup, "none")
    expert = Expert(world.track)
    drive = drive_setup(lambda _, mph: expert(world), world, setup)
    return steering_per_s(drive)


def _leave(folder: Path, world: World, drive: Drive, figures: dict, alarms: dict) -> None:
    write_drive(folder, drive, **alarms)
    title = (
        f"{world.track.name}, start seed {drive.seed}: autonomy {figures['autonomy']:.1%}, "
        f"{figures['interventions']} interventions"
    )
    save_figure(birds_eye(world.track, drive, title), folder / "track.png")
    save_figure(error_over_distance(drive, title), folder / "error.png")

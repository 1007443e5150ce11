"""Drives of a checkpoint, and what the expert would have done in what it saw."""

import hashlib
import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from rich.console import Console

from datamodules.errors import InputError
from simulator.errors import SimulatorError
from simulator.expert import Expert, ExpertSettings
from simulator.recorder import IMAGE_FOLDER, LOG_NAME, Recorder, split_pedals
from simulator.rig import CAMERAS
from simulator.weather import read_weather
from simulator.world import World
from zoo.cli.console_progress import progress_bar
from zoo.correct.correct_options import FIRST_SEED, CorrectOptions
from zoo.drives.drive_record import DriveRow
from zoo.evaluate.embedded_drive import Policy
from zoo.evaluate.many_drives import Setup, drive_setup, open_setup
from zoo.evaluate.process_pool import drive_in_processes

NUDGE_EVERY_S, NUDGE_S = 4.0, 0.5
YEARS_S = 50 * 365 * 24 * 3600


@dataclass(frozen=True)
class Asked:
    """A frame that the model saw: from where, and what the expert would have done.

    Attributes:
        pose: of the car, as `World.pose`.
        frame: its number, of which the picture's grain depends.
        steering, throttle: the expert's, -1..1.
    """

    pose: tuple[float, float, float, float, float]
    frame: int
    steering: float
    throttle: float


class AskingPolicy:
    """Drives as the model does, and asks the expert at every frame.

    Args:
        policy: the model's.
        world: that is driven in.
        expert_mph: that the expert's throttle is for.
        beta: the share of seconds in which the expert's steering drives (Ross et al. 2011).
        nudge: steering added for half a second now and then, up to so much, so that a model that
            drives well gets off its line, too; after Laskey et al., "DART", 2017, arXiv:1703.09327.
        seed: of both.
    """

    def __init__(
        self,
        policy: Policy,
        world: World,
        expert_mph: float,
        beta: float,
        nudge: float,
        seed: int,
    ) -> None:
        self.policy, self.world, self.beta, self.nudge = policy, world, beta, nudge
        # An answer is no movement: it need not be near the one before.
        self.expert = Expert(world.track, ExpertSettings(expert_mph, steering_per_s=50))
        self.asked: list[Asked] = []
        self.seed = seed

    def __call__(self, frame: np.ndarray, speed_mph: float) -> tuple[float, float | None]:
        world = self.world
        steering, throttle = self.policy(frame, speed_mph)
        answer = self.expert(world)
        self.asked.append(Asked(world.pose(), world.frames, *answer))
        second = np.random.default_rng([self.seed, 0, int(world.time)])
        if second.random() < self.beta:
            return answer[0], throttle
        number, since_s = divmod(world.time, NUDGE_EVERY_S)
        push = np.random.default_rng([self.seed, 1, int(number)])
        begin_s, force = push.uniform(0, NUDGE_EVERY_S - NUDGE_S), push.uniform(-1, 1)
        if begin_s <= since_s < begin_s + NUDGE_S:
            steering += self.nudge * force
        return steering, throttle


def worth_keeping(
    rows: list[DriveRow], before_s: float, after_s: float, off_m: float | None
) -> np.ndarray:
    """Which frames of a drive to train on, bool [N]: those so long before an intervention, in which
    it went wrong, so long after it, and all that are farther off than `off_m`."""
    time_s = np.array([row.time_s for row in rows])
    lost = np.flatnonzero([row.intervention for row in rows])
    keep = np.zeros(len(rows), bool)
    if off_m is not None:
        keep |= np.abs([row.cross_track_m for row in rows]) >= off_m
    begin = 0
    for number in lost:
        stretch = np.arange(begin, number + 1)
        keep[stretch[time_s[stretch] >= time_s[number] - before_s]] = True
        begin = number + 1
        after = np.arange(begin, len(rows))
        keep[after[time_s[after] < time_s[number] + after_s]] = True
    return keep


def collect(
    checkpoint: str,
    options: CorrectOptions,
    round_number: int,
    identity: str,
    folder: Path,
    console: Console,
) -> int:
    """Drive on every track with seeds of the round's own, and leave what is worth training on in
    `folder`, as a recording; returns its number of rows. With 0 there is no such folder.

    Args:
        identity: of the checkpoint that is corrected; file names are drawn from it, so that those
            of several corrections differ.
        console: where progress is shown.

    Raises:
        InputError: the simulator cannot be opened, the disk is full, a process was ended.
    """
    parts = folder.with_name(f"{folder.name}.parts")
    shutil.rmtree(parts, ignore_errors=True)
    first = FIRST_SEED + (round_number - 1) * options.drives
    jobs = []
    for track in options.scored.tracks:
        for seed in range(first, first + options.drives):
            setup = Setup.of(options.scored, track, seed)
            setup = replace(setup, weather=read_weather(options.weather))
            digest = hashlib.sha256(f"{identity} {track} {seed}".encode()).digest()
            begin_s = int.from_bytes(digest[:8], "big") % YEARS_S
            place = parts / f"{len(jobs):03d}"
            jobs.append((checkpoint, setup, options, options.beta**round_number, begin_s, place))
    with progress_bar(f"collecting {len(jobs)} drives", console) as show:
        found = drive_in_processes(collect_drive, jobs, options.workers, show)
        rows = sum(rows for _, rows in found)
    if rows:
        _join(sorted(parts.iterdir()), folder)
    shutil.rmtree(parts, ignore_errors=True)
    return rows


def collect_drive(
    checkpoint: str,
    setup: Setup,
    options: CorrectOptions,
    beta: float,
    begin_s: float,
    folder: Path,
    report: Callable[[float], None] | None = None,
) -> int:
    """Drive once in this process and record it; returns the number of rows.

    The first row is `begin_s` after the recorder's first moment; `report` is called at every frame
    with the share that is driven, 0..1.
    """
    import torch

    from zoo.checkpoints.policy import load_policy

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        world = open_setup(setup, "auto")
        policy = AskingPolicy(
            load_policy(checkpoint),
            world,
            options.expert_speed,
            beta,
            options.nudge,
            setup.seed,
        )
        drive = drive_setup(policy, world, setup, report=report)
        keep = worth_keeping(drive.rows, options.before_s, options.after_s, options.off_m)
        with Recorder(folder, relative=True) as recorder:
            _record(recorder, world, drive.rows, policy.asked, keep, begin_s)
        world.pictures.close()
    except SimulatorError as error:
        raise InputError(str(error)) from None
    finally:
        torch.set_num_threads(threads)
    return recorder.rows


def _record(
    recorder: Recorder,
    world: World,
    rows: list[DriveRow],
    asked: list[Asked],
    keep: np.ndarray,
    begin_s: float,
) -> None:
    """A pass for each stretch of frames that follow each other. Only now the side cameras look."""
    before, stretch_s = -2, 0.0
    for number in np.flatnonzero(keep):
        row, answer = rows[number], asked[number]
        # Being put back takes no time, and is no driving.
        if number != before + 1 or rows[before].intervention:
            recorder.begin_pass()
            stretch_s = row.time_s if recorder.rows else row.time_s - begin_s
        before = number
        frames = {
            camera: world.pictures.frame(answer.pose, camera, answer.frame) for camera in CAMERAS
        }
        pedals = split_pedals(answer.throttle)
        recorder.add(frames, answer.steering, *pedals, row.speed_mph, row.time_s - stretch_s)


def _join(parts: list[Path], folder: Path) -> None:
    """Several recordings with relative paths as one, which takes its name when it is whole."""
    whole = folder.with_name(f"{folder.name}.part")
    shutil.rmtree(whole, ignore_errors=True)
    (whole / IMAGE_FOLDER).mkdir(parents=True)
    lines: list[str] = []
    for part in parts:
        if (part / LOG_NAME).is_file():
            lines += (part / LOG_NAME).read_text().splitlines()
            for image in (part / IMAGE_FOLDER).iterdir():
                image.rename(whole / IMAGE_FOLDER / image.name)
    # File names begin with the time.
    (whole / LOG_NAME).write_text("\n".join(sorted(lines)) + "\n")
    whole.rename(folder)

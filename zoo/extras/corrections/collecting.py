"""Drives of a checkpoint, recorded with what the expert would have done at each frame."""

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from rich.console import Console

from datamodules.driving_log import CAMERAS
from zoo.base.new_folder import whole_folder
from zoo.base.terminal import counted
from zoo.base.whole_file import write_whole
from zoo.checkpoints.policy_base import Command, Policy, PolicyWrapper
from zoo.driving.drive_record import Drive, DriveRow
from zoo.driving.embedded_world import EmbeddedWorld, instant_expert
from zoo.driving.run_drives import Keep, PolicyMaker, all_drives, load_kept
from zoo.driving.scenario import Scenario
from zoo.extras.corrections.correct_options import FIRST_SEED, CorrectOptions
from zoo.simulator.recorder import IMAGE_FOLDER, LOG_NAME, Recorder, split_pedals
from zoo.simulator.simulated_world import World
from zoo.simulator.weather import read_weather

NUDGE_EVERY_S, NUDGE_S = 4.0, 0.5
Pose = tuple[float, float, float, float, float]  # see `zoo.simulator.simulated_world.World.pose`
START_RANGE_S = 50 * 365 * 24 * 3600  # recordings start anywhere within 50 years


class LabellingPolicy(PolicyWrapper):
    """A policy that drives as the model does, and stores the expert's label at every frame.

    Args:
        policy: policy of the model.
        world: world in which it drives.
        expert_mph: speed that the expert's throttle holds.
        beta: share of seconds in which the expert steers, 0..1 (Ross et al. 2011).
        nudge: largest steering added for half a second in every 4 s, 0..1, so that a model that
            drives well leaves its line, too; after Laskey et al., "DART", 2017, arXiv:1703.09327.
        seed: random seed of the expert's seconds and the nudges.

    Attributes:
        labels: what the expert would have done at each frame: the car's pose, as `World.pose`
            returns it; the number of the frame, which seeds the image's noise; and the expert's
            steering and throttle, -1..1.
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
        super().__init__(policy)
        self.world, self.beta, self.nudge = world, beta, nudge
        self.expert = instant_expert(world, expert_mph)
        self.labels: list[tuple[Pose, int, tuple[float, float]]] = []
        self.seed = seed

    def __call__(self, frame: np.ndarray, speed_mph: float) -> Command:
        """Store the expert's label, and return the command that drives."""
        world = self.world
        command = self.policy(frame, speed_mph)
        label = self.expert(world)
        self.labels.append((world.pose(), world.frames, label))
        if np.random.default_rng([self.seed, 0, int(world.time)]).random() < self.beta:
            return replace(command, steering=label[0])
        number, since_s = divmod(world.time, NUDGE_EVERY_S)
        push = np.random.default_rng([self.seed, 1, int(number)])
        begin_s, force = push.uniform(0, NUDGE_EVERY_S - NUDGE_S), push.uniform(-1, 1)
        if begin_s <= since_s < begin_s + NUDGE_S:
            return replace(command, steering=command.steering + self.nudge * force)
        return command


def worth_keeping(
    rows: list[DriveRow], before_s: float, after_s: float, off_m: float | None
) -> np.ndarray:
    """Return which frames of a drive to train on, bool [N].

    Args:
        rows: rows of the drive.
        before_s: seconds to keep before an intervention.
        after_s: seconds to keep after it.
        off_m: distance from the centreline, in metres, from which frames are kept, too.
    """
    time_s = np.array([row.time_s for row in rows])
    interventions = np.flatnonzero([row.intervention for row in rows])
    keep = np.zeros(len(rows), bool)
    if off_m is not None:
        keep |= np.abs([row.cross_track_m for row in rows]) >= off_m
    begin = 0
    for number in interventions:
        end = number + 1
        keep[begin:end] |= time_s[begin:end] >= time_s[number] - before_s
        keep[end:] |= time_s[end:] < time_s[number] + after_s
        begin = end
    return keep


def collect(
    checkpoint: str,
    options: CorrectOptions,
    round_number: int,
    identity: str,
    folder: Path,
    console: Console,
) -> int:
    """Drive on every track, and record in `folder` the frames that are worth training on.

    Args:
        checkpoint: path of the checkpoint that drives.
        options: tracks, drives, and what to keep.
        round_number: number of the round, from 1; each round has its own seeds.
        identity: hash of the checkpoint to correct; it makes file names differ between corrections.
        folder: folder of the new recording; not created without a row.
        console: output of the progress.

    Returns:
        The number of rows.

    Raises:
        InputError: the simulator cannot open, the disk is full, or a process was killed.
    """
    first = FIRST_SEED + (round_number - 1) * options.drives
    with TemporaryDirectory(dir=folder.parent, prefix=f".{folder.name}.") as name:
        parts = Path(name)
        scenarios = [
            replace(scenario, seed=first + seed, weather=read_weather(options.weather))
            for scenario in options.scored
            if scenario.seed == 0
            for seed in range(options.drives)
        ]
        keeps = []
        for number, scenario in enumerate(scenarios):
            seeded = f"{identity} {scenario.track} {scenario.seed}"
            digest = hashlib.sha256(seeded.encode()).digest()
            begin_s = int.from_bytes(digest[:8], "big") % START_RANGE_S
            keeps.append(RecordedErrors(parts / f"{number:03d}", options, begin_s))
        labelled = Labelled(checkpoint, options, options.beta**round_number)
        what = f"collecting {counted(len(scenarios), 'drive')}"
        rows = sum(all_drives(labelled, scenarios, keeps, options.workers, what, console))
        if rows:
            _join(sorted(parts.iterdir()), folder)
    return rows


@dataclass(frozen=True)
class Labelled(PolicyMaker):
    """What makes the labelling policy of a drive.

    Args:
        checkpoint: checkpoint file, or a policy.
        options: options of the correction.
        beta: see `LabellingPolicy`.
    """

    checkpoint: str
    options: CorrectOptions
    beta: float

    def policy(self, world: EmbeddedWorld, scenario: Scenario) -> LabellingPolicy:
        """Return the checkpoint's policy, labelled by the expert of the world."""
        return LabellingPolicy(
            load_kept(self.checkpoint).scored(),
            world.simulated,
            self.options.expert_speed,
            self.beta,
            self.options.nudge,
            scenario.seed,
        )


@dataclass(frozen=True)
class RecordedErrors(Keep):
    """A recording of what is worth training on in a drive; the drive results in its number of rows.

    Args:
        folder: folder of the recording.
        options: options of the correction.
        begin_s: time of the first row, in seconds after the recorder's start.
    """

    folder: Path
    options: CorrectOptions
    begin_s: float

    def result(self, drive: Drive, policy: LabellingPolicy, world: EmbeddedWorld) -> int:
        """Record the drive, and return the number of rows."""
        options, labels, rows = self.options, policy.labels, drive.rows
        keep = worth_keeping(rows, options.before_s, options.after_s, options.off_m)
        before = -2
        with Recorder(self.folder, relative=True) as recorder:
            for number in np.flatnonzero(keep).tolist():
                row, (pose, frame, (steering, throttle)) = rows[number], labels[number]
                # After an intervention the car is elsewhere.
                if number != before + 1 or rows[before].intervention:
                    recorder.begin_pass(row.time_s - (0.0 if recorder.rows else self.begin_s))
                before = number
                # The side cameras are rendered here: the drive needs only the centre camera.
                renderer = world.simulated.drawing()
                frames = {camera: renderer.frame(pose, camera, frame) for camera in CAMERAS}
                numbers = (steering, *split_pedals(throttle), row.speed_mph)
                recorder.add(frames, *numbers, row.time_s)
        return recorder.rows


def _join(parts: list[Path], folder: Path) -> None:
    """Join recordings with relative paths; the result gets its name when it is complete."""
    with whole_folder(folder) as whole:
        (whole / IMAGE_FOLDER).mkdir()
        lines: list[str] = []
        for part in parts:
            if (part / LOG_NAME).is_file():
                lines += (part / LOG_NAME).read_text(encoding="utf-8").splitlines()
                for image in (part / IMAGE_FOLDER).iterdir():
                    image.rename(whole / IMAGE_FOLDER / image.name)
        # Lines begin with file names, and these with the time.
        write_whole(whole / LOG_NAME, "\n".join(sorted(lines)) + "\n")

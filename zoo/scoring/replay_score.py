"""Score of a checkpoint on a recording; see `zoo.driving.replay_world`."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from datamodules.formats.recording_writer import whole_rows, write_frame
from datamodules.looking.findings import KEYBOARD_SHARE, report_recordings, skipped_lines
from datamodules.recorded_car import other_car
from datamodules.recording import Recording
from datamodules.recording_format import read_recordings
from datamodules.split import Split
from datamodules.stretches import STRETCH_S, long_stretches
from zoo.base.command_keys import changed
from zoo.base.errors import InputError
from zoo.base.new_folder import command_folder
from zoo.base.terminal import counted, print_written
from zoo.checkpoints.checkpoint import added_rig
from zoo.checkpoints.checkpoint_policy import load_policy
from zoo.checkpoints.policy_base import Policy, PolicyFunction, read_as_trained
from zoo.driving.drive_log import write_drive
from zoo.driving.drive_record import Drive, DriveRow
from zoo.driving.drives_table import (
    figure_columns,
    mean_and_spread,
    nan_line,
    print_drives,
    tied_line,
)
from zoo.driving.metrics import METRICS, REPLAYS, measure
from zoo.driving.replay_world import ReplayWorld
from zoo.driving.run_drives import Keep, all_drives
from zoo.driving.scenario import Scenario
from zoo.driving.world import World
from zoo.runs.metrics_file import write_metrics_file
from zoo.runs.plots import save_figure
from zoo.runs.result_table import Table, known
from zoo.runs.table_files import Result
from zoo.scoring.drive_plots import error_over_distance
from zoo.scoring.evaluate_options import ReplayOptions
from zoo.scoring.evidence import other_car_line, source_of

FRAMES = "frames"


@dataclass(frozen=True, repr=False)
class Replay(Result):
    """The replay of a recording.

    Attributes:
        folder: folder with `metrics.json`, the drive and a plot.
        figures: figures of the drive by name.
        notes: what was replayed and with which rig, if it is not Udacity's; and a warning for each
            recording that was driven with a keyboard.
        checkpoint: path of the checkpoint, or the policy's name.
        problem: what makes the figures invalid, such as steering NaN; empty if nothing does.
        following: words of the next command.
        written: further files that the user asked for.
    """

    folder: Path
    figures: dict[str, Any]
    notes: list[str]
    checkpoint: str
    problem: str = ""
    following: list[object] = field(default_factory=list)
    written: list[Path] = field(default_factory=list)

    def __repr__(self) -> str:
        lost = counted(self.figures["interventions"], "intervention")
        return f"Replay in {self.folder}: autonomy {self.figures['autonomy']:.1%}, {lost}"

    def show(self) -> None:
        """Print the figures, the warnings and what was written."""
        console = Console(emoji=False)
        print_drives({"replay": mean_and_spread([self.figures])}, console, REPLAYS)
        for line in self.notes:
            console.print(line, highlight=False, markup=False, soft_wrap=True)
        print_written([self.folder, *self.written], self.following, console)

    def result_table(self) -> Table:
        """Return one row with all figures."""
        columns = [
            replace(column, figures={column.name: [self.figures[column.name]]})
            for column in figure_columns({"replay": mean_and_spread([self.figures])}, REPLAYS)
            if column.name in self.figures
        ]
        return Table(columns, f"Replay in {self.folder.name}")


def replay_recording(
    driver: str | Policy | PolicyFunction,
    recording_folder: str,
    options: ReplayOptions,
    console: Console,
) -> Replay:
    """Replay a recording, and write `metrics.json`, the drive and a plot.

    Args:
        driver: path of a checkpoint, or a policy.
        recording_folder: recording's folder.
        options: options of the replay.
        console: console for the progress.

    Raises:
        InputError: the checkpoint cannot be loaded, the recording does not exist or cannot be
            replayed, or an option is wrong.
    """
    options.check_files(METRICS, [recording_folder])
    policy = load_policy(driver)
    name = driver if isinstance(driver, str) else policy.name
    said = read_as_trained([policy], recording_folder, options.data)
    recording, damaged = whole_rows(read_recordings(recording_folder, **said))
    if damaged and said.get("on_bad_image") != "skip":
        raise InputError(f"{damaged[0]}; data.on_bad_image=skip leaves such rows out")
    is_own = policy.data.get("fingerprint") == recording.fingerprint()
    if is_own and recording.rig is None and isinstance(driver, str):
        recording = replace(recording, rig=added_rig(driver))
    world = ReplayWorld(recording, options.frame_rate, options.speed)
    source = other_car(recording)
    line = other_car_line(policy.data, f"a replay of {recording_folder}", source)
    if line and not is_own:
        console.print(line, highlight=False, markup=False, soft_wrap=True)
    with command_folder(options.out, "replays") as folder:
        keep = ReplayFrames(folder if options.frames else None)
        scenario, what = Scenario(margin=options.margin), "replaying"
        (drive,) = all_drives(policy, [scenario], keep, what=what, console=console, world=world)
        figures: dict[str, Any] = {key: known(value) for key, value in measure(drive).items()}
        about = {"checkpoint": name, "recording": list(recording.names), "replayed": world.words}
        write_drive(folder, drive, **about)
        write_metrics_file(folder, about | {"margin_m": drive.lane_m, "replay": figures})
        title = (
            f"replay of {Path(recording.names[0]).name}: autonomy {figures['autonomy']:.1%}, "
            f"{counted(figures['interventions'], 'intervention')}"
        )
        save_figure(error_over_distance(drive, title), folder / "error.png")
        nan = nan_line([{"track": "replay", "seed": drive.seed, "nan_frames": drive.nan_frames}])
        problem = f"{name}: {nan}" if nan else ""
        on_track = source is None and source_of(policy.data) is None
        notes = [world.words] * (source is not None) + keyboard_lines(recording, on_track)
        notes += skipped_lines(replace(recording, bad_images=(*recording.bad_images, *damaged)))
        notes += filter(None, [tied_line([{"tied": drive.tied}])])
        following: list[object] = ["film", folder] if options.frames else ["evaluate", name]
        if not on_track and not options.frames:
            filmed = replace(options, frames=True, out=None, table=None, columns=None)
            following = ["replay", name, recording_folder, *changed(filmed)]
        result = Replay(folder, figures, notes, name, problem, following)
        result.written.extend(options.write_files(result))
        return result


def held_out_replay(recording: Recording, split: Split, speed_mph: float | None) -> ReplayWorld:
    """Return the replay of the rows that are not trained on, in stretches that are long enough.

    Args:
        recording: recording of a training.
        split: its split; the rows of `val` and `test` are held out.
        speed_mph: speed of every row, for a recording that holds none.

    Raises:
        InputError: no stretch is long enough, or see `ReplayWorld`.
    """
    stretches = long_stretches(recording, np.union1d(split.val, split.test))
    if not stretches and recording.rig is not None:
        raise InputError(
            f"{', '.join(recording.names)}: no held-out rows follow each other for "
            f"{STRETCH_S:g} s; data.split=blocks data.block_s=10 holds out blocks of 10 s"
        )
    return ReplayWorld(recording, speed_mph=speed_mph, stretches=stretches)


def keyboard_lines(recording: Recording, on_track: bool) -> list[str]:
    """Return a warning for each recording that was driven with a keyboard.

    Args:
        recording: recording that was replayed.
        on_track: whether the embedded tracks show the car of the recording and of the network.
    """
    remedy = "score it on a track: drivezoo evaluate CKPT track=lake"
    remedy = remedy if on_track else "record with a joystick to score it"
    return [
        f"{row.name}: {row.zero_share:.0%} of the steering is exactly 0, as with a keyboard. Such "
        "a path weaves around the lane's centre, so these figures say little about the network; "
        f"{remedy}"
        for row in report_recordings(recording)
        if row.zero_share > KEYBOARD_SHARE
    ]


class ReplayFrames(Keep):
    """A drive whose warped frames are written.

    Args:
        folder: folder of the drive; None writes no frames.
    """

    def __init__(self, folder: Path | None) -> None:
        self.folder = folder
        self.names: list[str] = []
        if folder is not None:
            (folder / FRAMES).mkdir()

    def show(self, frame: np.ndarray, row: DriveRow) -> None:
        """Write a frame."""
        if self.folder is not None:
            self.names.append(f"{FRAMES}/{len(self.names):06d}.jpg")
            write_frame(frame, self.folder / self.names[-1])

    def result(self, drive: Drive, policy: Policy, world: World) -> Drive:
        """Return the drive with the paths of its frames."""
        return replace(drive, frame=np.array(self.names)) if self.names else drive

"""Score of a checkpoint on a recording; see `zoo.worlds.replay_world`."""

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich.console import Console

from datamodules.findings import KEYBOARD_SHARE, report_recordings
from datamodules.formats.recording_writer import write_frame
from datamodules.recording import Recording, read_recordings
from zoo.base.new_folder import command_folder
from zoo.checkpoints.checkpoint_path import find_driver
from zoo.cli.closing_lines import print_written
from zoo.cli.console_progress import loading
from zoo.drives.drive_log import write_drive
from zoo.drives.drive_record import Drive, DriveRow
from zoo.drives.metrics import METRICS, REPLAYS, measure
from zoo.evaluate.evaluate_options import ReplayOptions
from zoo.runs.table import Table
from zoo.runs.table_files import Result, check_table, write_asked
from zoo.worlds.run_drives import Keep
from zoo.worlds.scenario import Scenario

if TYPE_CHECKING:
    from zoo.checkpoints.command import Policy, PolicyFunction
    from zoo.worlds.world import World

FRAMES = "frames"


@dataclass(frozen=True, repr=False)
class Replay(Result):
    """The replay of a recording.

    Attributes:
        folder: folder with `metrics.json`, the drive and a plot.
        figures: figures of the drive by name.
        keyboard: a warning for each recording that was driven with a keyboard.
        checkpoint: path of the checkpoint, or the policy's name.
        problem: what makes the figures invalid, such as steering NaN; empty if nothing does.
        written: further files that the user asked for.
    """

    folder: Path
    figures: dict[str, float | None]
    keyboard: list[str]
    checkpoint: str
    problem: str = ""
    written: list[Path] = field(default_factory=list)

    def __repr__(self) -> str:
        lost = f"{self.figures['interventions']:g} interventions"
        return f"Replay in {self.folder}: autonomy {self.figures['autonomy']:.1%}, {lost}"

    def show(self) -> None:
        """Print the figures, the warnings and what was written."""
        from zoo.evaluate.drives_table import mean_and_spread, print_drives

        console = Console(emoji=False)
        print_drives({"replay": mean_and_spread([self.figures])}, console, REPLAYS)
        for line in self.keyboard:
            console.print(line, highlight=False, markup=False, soft_wrap=True)
        has_frames = (self.folder / FRAMES).is_dir()
        following = ["film", self.folder] if has_frames else ["evaluate", self.checkpoint]
        print_written([self.folder, *self.written], following, console)

    def result_table(self) -> Table:
        """Return one row with all figures."""
        from zoo.evaluate.drives_table import figure_columns, mean_and_spread

        columns = figure_columns({"replay": mean_and_spread([self.figures])}, REPLAYS)
        return Table(
            [
                replace(one, figures={one.name: [self.figures[one.name]]})
                for one in columns
                if one.name in self.figures
            ],
            f"Replay in {self.folder.name}",
        )


def replay_recording(
    checkpoint: "str | Policy | PolicyFunction",
    recording_folder: str,
    options: ReplayOptions,
    console: Console,
) -> Replay:
    """Replay a recording, and write `metrics.json`, the drive and a plot.

    Args:
        checkpoint: path as users name it, or a policy.
        recording_folder: recording's folder.
        options: options of the replay.
        console: console for the progress.

    Raises:
        InputError: the checkpoint or recording does not exist, the recording cannot be replayed, or
            an option is wrong.
    """
    check_table(options.table, options.columns, METRICS)
    checkpoint = find_driver(checkpoint)  # reports a wrong path before torch is imported
    with loading():
        from zoo.checkpoints.command import as_policy
        from zoo.checkpoints.policy import load_policy
        from zoo.evaluate.drive_plots import error_over_distance
        from zoo.evaluate.drives_table import nan_line
        from zoo.runs.metrics_file import write_metrics_file
        from zoo.runs.plots import save_figure
        from zoo.worlds.replay_world import ReplayWorld
        from zoo.worlds.run_drives import all_drives

        is_file = isinstance(checkpoint, str)
        policy = load_policy(checkpoint) if is_file else as_policy(checkpoint)
        name = checkpoint if is_file else policy.name
        recording = read_recordings(recording_folder)
        world = ReplayWorld(recording, options.frame_rate, options.speed)
    with command_folder(options.out, "replays") as folder:
        scenario = Scenario(margin=options.margin)
        keep = ReplayFrames(folder if options.frames else None)
        (drive,) = all_drives(
            policy, [scenario], keep, what="replaying", console=console, world=world
        )
        figures = measure(drive)
        figures = {key: value if math.isfinite(value) else None for key, value in figures.items()}
        about = {"checkpoint": name, "recording": list(recording.names)}
        write_drive(folder, drive, **about)
        metrics = about | {"margin_m": options.margin, "replay": figures}
        write_metrics_file(folder, metrics)
        title = (
            f"replay of {Path(recording.names[0]).name}: autonomy {figures['autonomy']:.1%}, "
            f"{figures['interventions']} interventions"
        )
        save_figure(error_over_distance(drive, title), folder / "error.png")
        replayed = {"track": "replay", "seed": drive.seed, "nan_frames": drive.nan_frames}
        nan = nan_line([replayed])
        problem = f"{name}: {nan}" if nan else ""
        found = Replay(folder, figures, keyboard_lines(recording), name, problem)
        found.written.extend(write_asked(found, options.table, columns=options.columns))
        return found


def keyboard_lines(recording: Recording) -> list[str]:
    """Return a warning for each recording that was driven with a keyboard."""
    return [
        f"{one.name}: {one.zero_share:.0%} of the steering is exactly 0, as with a keyboard. Such "
        "a path weaves around the lane's centre, so these figures say little about the network; "
        "score it on a track: drivezoo evaluate CKPT track=lake"
        for one in report_recordings(recording)
        if one.zero_share > KEYBOARD_SHARE
    ]


class ReplayFrames(Keep):
    """A drive whose warped frames are written.

    Args:
        folder: folder of the drive; None writes no frames.
    """

    def __init__(self, folder: Path | None) -> None:
        self.folder, self.names = folder, []
        if folder is not None:
            (folder / FRAMES).mkdir()

    def show(self, frame: np.ndarray, row: DriveRow) -> None:
        """Write a frame."""
        if self.folder is not None:
            self.names.append(f"{FRAMES}/{len(self.names):06d}.jpg")
            write_frame(frame, self.folder / self.names[-1])

    def result(self, drive: Drive, policy: "Policy", world: "World") -> Drive:
        """Return the drive with the paths of its frames."""
        return replace(drive, frame=np.array(self.names)) if self.names else drive

"""Score of a checkpoint on a recording; see `zoo.evaluate.recording_replay`."""

import datetime
import math
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from rich.console import Console
from rich.progress import Progress

from datamodules.errors import InputError
from datamodules.recording import Recording, read_recordings
from datamodules.recording_report import KEYBOARD_SHARE, report_recordings
from zoo.checkpoints.checkpoint_path import find_checkpoint
from zoo.cli.closing_lines import print_written
from zoo.cli.console_progress import loading
from zoo.drives.drive_log import write_drive
from zoo.drives.drive_record import DriveRow

FRAMES = "frames"


@dataclass(frozen=True, kw_only=True)
class ReplayOptions:
    """Options of a replay; `conf/replay.yaml` has their meanings and defaults."""

    margin: float
    frame_rate: float | None
    frames: bool
    out: str | None


def replay_recording(
    checkpoint: str, recording_folder: str, options: ReplayOptions, console: Console
) -> dict:
    """Replay a recording, print and write the results, and return the figures.

    The files are `metrics.json`, the drive and a plot.

    Raises:
        InputError: the checkpoint or recording does not exist, the recording cannot be replayed, or
            an option is wrong; or the network steered NaN, after all files are written.
    """
    checkpoint = str(find_checkpoint(checkpoint))  # reports a wrong path before torch is imported
    with loading():
        import torch

        from zoo.checkpoints.policy import load_policy
        from zoo.drives.metrics import REPLAYS, measure
        from zoo.evaluate.drive_plots import error_over_distance
        from zoo.evaluate.drives_table import drives_table, mean_and_spread, nan_line
        from zoo.evaluate.recording_replay import replay
        from zoo.runs.metrics_file import write_metrics_file
        from zoo.runs.plots import save_figure

        policy = load_policy(checkpoint)
        recording = read_recordings(recording_folder)
    torch.set_num_threads(1)  # one frame is too little work for two threads
    with _Shown(recording, options, console) as shown:
        drive = replay(policy, recording, options.margin, options.frame_rate, shown)
    figures = measure(drive)
    figures = {key: value if math.isfinite(value) else None for key, value in figures.items()}
    about = {"checkpoint": str(checkpoint), "recording": list(recording.names)}
    kept = replace(drive, frame=np.array([row.frame for row in shown.rows]))
    write_drive(shown.folder, kept, **about)
    metrics = about | {"margin_m": options.margin, "replay": figures}
    write_metrics_file(shown.folder, metrics)
    title = (
        f"replay of {Path(recording.names[0]).name}: autonomy {figures['autonomy']:.1%}, "
        f"{figures['interventions']} interventions"
    )
    save_figure(error_over_distance(drive, title), shown.folder / "error.png")
    console.print(drives_table({"replay": mean_and_spread([figures])}, REPLAYS))
    for line in keyboard_lines(recording):
        console.print(line, highlight=False, markup=False, soft_wrap=True)
    following = ["zoo.film", shown.folder] if options.frames else ["zoo.evaluate", checkpoint]
    print_written([shown.folder], following, console)
    replayed = {"track": "replay", "seed": drive.seed, "nan_frames": drive.nan_frames}
    if nan := nan_line([replayed]):
        raise InputError(f"{checkpoint}: {nan}")
    return figures


def keyboard_lines(recording: Recording) -> list[str]:
    """Return a warning for each recording that was driven with a keyboard."""
    return [
        f"{one.name}: {one.zero_share:.0%} of the steering is exactly 0, as with a keyboard. Such "
        "a path weaves around the lane's centre, so these figures say little about the network; "
        "score it on a track: python -m zoo.evaluate CKPT track=lake"
        for one in report_recordings(recording)
        if one.zero_share > KEYBOARD_SHARE
    ]


class _Shown:
    """A callback of `replay` that shows progress and keeps rows and, optionally, frames."""

    def __init__(self, recording: Recording, options: ReplayOptions, console: Console) -> None:
        now = datetime.datetime.now()
        out = options.out or f"outputs/replays/{now:%Y-%m-%d}/{now:%H-%M-%S-%f}"
        self.folder, self.keep = Path(out).expanduser(), options.frames
        self.rows: list[DriveRow] = []
        if self.folder.exists() and not (self.folder.is_dir() and not any(self.folder.iterdir())):
            raise InputError(f"{self.folder}: is not empty; name another folder with out=")
        self.progress = Progress(console=console, transient=True, disable=not console.is_terminal)
        self.task = self.progress.add_task("replaying", total=len(recording))

    def __enter__(self) -> "_Shown":
        self.progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.progress.stop()

    def __call__(self, frame: np.ndarray, row: DriveRow) -> None:
        if not self.rows:  # created late: a recording that cannot be replayed leaves no folder
            self._make_folder()
        if self.keep:
            name = f"{FRAMES}/{len(self.rows):06d}.jpg"
            cv2.imwrite(str(self.folder / name), frame[..., ::-1])
            row = replace(row, frame=name)
        self.rows.append(row)
        self.progress.update(self.task, advance=1)

    def _make_folder(self) -> None:
        try:
            (self.folder / FRAMES if self.keep else self.folder).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{self.folder}: cannot be written ({error.strerror})") from None

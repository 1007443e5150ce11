"""A run, or an evaluation, as its report reads it."""

from abc import ABC, abstractmethod
from functools import cached_property
from pathlib import Path
from typing import Any

from datamodules.format_options import said_in
from datamodules.recording import Recording
from datamodules.recording_format import read_recordings
from zoo.base.errors import InputError
from zoo.checkpoints.checkpoint import Checkpoint, load_checkpoint
from zoo.checkpoints.checkpoint_path import on_server, short_name, trained_paths
from zoo.checkpoints.checkpoint_policy import CheckpointPolicy, load_policy
from zoo.checkpoints.policy_base import Policy
from zoo.driving.drive_log import LOG_NAME, read_drive
from zoo.driving.drive_record import WrittenDrive
from zoo.runs.metrics_file import read_metrics_file
from zoo.runs.page import last_folders
from zoo.runs.run_record import Run
from zoo.scoring.blocks import Image


class ReportedDrives(ABC):
    """The drives of a run or of an evaluation; what is missing raises InputError or OSError.

    Attributes:
        folder: folder of the run or the evaluation.
        metrics: contents of `metrics.json`.
        tracks: figures of each track, see `mean_and_spread`.
        replayed: which drives of a recording were replayed, in words; None for none.
        status: contents of `status.json`; empty without one.
    """

    folder: Path
    metrics: dict
    tracks: dict[str, dict]
    drive_folders: list[Path]
    status: dict[str, Any]
    replayed: str | None

    @property
    @abstractmethod
    def policy(self) -> Policy:
        """Load what drove; raise InputError if it is missing or damaged."""

    @property
    @abstractmethod
    def title(self) -> str:
        """Return the title of the report."""

    @property
    def drives(self) -> list[WrittenDrive]:
        """Return the scored drives by track and start seed, without damaged ones."""
        return self._read_drives[0]

    @property
    def damaged_drives(self) -> list[str]:
        """Return a line for each damaged drive."""
        return self._read_drives[1]

    @cached_property
    def _read_drives(self) -> tuple[list[WrittenDrive], list[str]]:
        drives, damaged = [], []
        for folder in self.drive_folders:
            try:
                drive = read_drive(folder)
            except InputError as error:
                damaged.append(str(error))
                continue
            if len(drive) and None not in map(drive.summary.get, ("track", "interventions")):
                drives.append(drive)
        return sorted(drives, key=lambda drive: (drive.track, drive.seed)), damaged


class ReportedEvaluation(ReportedDrives):
    """An evaluation with what its report shows.

    Args:
        folder: folder with its `metrics.json`.

    Raises:
        InputError: the file is damaged, or holds no drives.
    """

    replayed = None

    def __init__(self, folder: Path) -> None:
        self.folder, self.metrics, self.status = folder, read_metrics_file(folder), {}
        tracks = self.metrics.get("tracks") or {}
        self.tracks = {name: figures for name, figures in tracks.items() if figures}
        self.drive_folders = sorted(path.parent for path in folder.glob(f"*/{LOG_NAME}"))
        if not self.tracks:
            raise InputError(f"{folder}: has no drives on tracks; name one of outputs/evaluations")

    @property
    def title(self) -> str:
        """Return the name of what drove, or the last folders of its path, and the tracks."""
        name = str(self.metrics.get("checkpoint") or "a policy")
        shown = short_name(Path(name)) if not on_server(name) and Path(name).is_file() else name
        return f"{last_folders(shown)}: {', '.join(self.tracks)}"

    @cached_property
    def policy(self) -> Policy:
        """Load what drove; raise InputError if its file is gone, or it was a function."""
        path = Path(str(self.metrics.get("checkpoint")))
        if on_server(path) or not path.is_file():  # of a function the name alone is known
            raise InputError(f"{path}: no such file")
        return load_policy(path)


class ReportedRun(ReportedDrives, Run):
    """A run with what its report shows."""

    @classmethod
    def open(cls, folder: Path) -> "ReportedRun":
        """Return the run of a folder; its small files are read now.

        Raises:
            InputError: the folder is not a run's, or a file in it is damaged.
        """
        run = super().open(folder)
        config, _ = Run(folder).config, (run.status, run.metrics, run.overrides, run.choices)
        if not isinstance(config.get("data"), dict) or not isinstance(config.get("model"), dict):
            raise InputError(
                f"{folder}: is not a run of drivezoo train (its config has no data or no model); "
                "name another run"
            )
        return run

    @cached_property
    def checkpoint(self) -> Checkpoint:
        """Load the checkpoint; raise InputError if it is missing or damaged."""
        if self.checkpoint_path is None:
            raise InputError("The run has no checkpoint: no epoch was trained.")
        return load_checkpoint(self.checkpoint_path)

    @property
    def title(self) -> str:
        """Return the experiment's name, or the model's."""
        name = self.choices.get("experiment") or self.config["model"]["name"]
        return f"{name}, quick" if self.config.get("quick") else str(name)

    @cached_property
    def policy(self) -> Policy:
        """Return the checkpoint's policy."""
        return CheckpointPolicy(self.checkpoint)

    @cached_property
    def config(self) -> dict:
        """Return the checkpoint's config, which names the recording in `data.root`, or Hydra's."""
        try:
            return self.checkpoint.config
        except InputError:
            return super().config

    @cached_property
    def recording(self) -> Recording:
        """Read the recording again; raise InputError or OSError if it cannot be read."""
        data = self.config["data"] | trained_paths(self.config["data"], self.started_in)
        if data["root"] is None:
            raise InputError("The run stopped before it opened its recording.")
        return read_recordings(data["root"], **said_in(data) | {"on_bad_image": "skip"})

    @property
    def ended_early(self) -> str:
        """Return a sentence on why there are no figures; empty for a finished run."""
        if self.state in ("failed", "pruned"):
            return f"The run {self.state}: {self.status.get('reason') or 'for an unknown reason'}."
        # The run itself may write this report before it ends.
        return "" if self.metrics else f"The run has not finished ({self.state or 'unknown'})."

    def figures(self, key: str) -> Any:
        """Return a value of `metrics.json`; raise InputError if it is not there."""
        if self.metrics.get(key) is None:
            raise InputError(f"metrics.json has no {key}; only a finished run has figures.")
        return self.metrics[key]

    def plot(self, name: str, caption: str) -> Image:
        """Return a plot of the run; raise OSError if it is missing."""
        return Image.read(self.folder / "plots" / f"{name}.png", caption)

"""A run as its report reads it."""

from functools import cached_property
from pathlib import Path
from typing import Any

from datamodules.read_options import said_in
from datamodules.recording import Recording
from datamodules.recording_format import read_recordings
from zoo.base.errors import InputError
from zoo.checkpoints.checkpoint import Checkpoint, load_checkpoint
from zoo.drives.drive_log import read_drive
from zoo.drives.drive_record import Drive
from zoo.report.blocks import Image
from zoo.runs.run import Run


class ReportedRun(Run):
    """A run with what its report shows; what is missing raises InputError or OSError."""

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
        data = self.config["data"]
        root, images = data["root"], data.get("images")
        if root is None:
            raise InputError("The run stopped before it opened its recording.")
        roots = [self._found(one) for one in ([root] if isinstance(root, str) else root)]
        said = said_in(data) | {"on_bad_image": "skip"}
        return read_recordings(roots, **said | {"images": self._found(images) if images else None})

    @property
    def drives(self) -> list[Drive]:
        """Return the scored drives by track and start seed, without damaged ones."""
        return self._read_drives[0]

    @property
    def damaged_drives(self) -> list[str]:
        """Return a line for each damaged drive."""
        return self._read_drives[1]

    @cached_property
    def _read_drives(self) -> tuple[list[Drive], list[str]]:
        drives, damaged = [], []
        for folder in self.drive_folders:
            try:
                drive = read_drive(folder)
            except InputError as error:
                damaged.append(str(error))
                continue
            if len(drive) and None not in map(drive.summary.get, ("track", "autonomy")):
                drives.append(drive)
        return sorted(drives, key=lambda drive: (drive.track, drive.seed)), damaged

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
        path = self.folder / "plots" / f"{name}.png"
        return Image(path.name, path.read_bytes(), caption, plot=True)

    def _found(self, place: str) -> str:
        """Return a path of the run's config, relative to the folder where the run was started."""
        path = Path(place).expanduser()
        there = (self.started_in or Path()) / path
        return str(there if there.exists() and not path.exists() else path)

"""Read a run's folder for its report."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omegaconf import OmegaConf

from zoo.base.errors import InputError
from zoo.report.blocks import Image, MissingError
from zoo.runs.status import is_alive

if TYPE_CHECKING:
    from datamodules.recording import Recording
    from zoo.checkpoints.checkpoint import Checkpoint
    from zoo.drives.drive_record import Drive


@dataclass(frozen=True)
class Run:
    """The files of a run.

    Attributes:
        folder: run's folder.
        hydra_config: config as Hydra composed it.
        choices: option of each config group.
        overrides: arguments of `drivezoo train`.
        started_in: folder to which relative paths are relative; None if it was not saved.
        status: contents of `status.json`.
        metrics: contents of `metrics.json`; empty before the run has finished.
    """

    folder: Path
    hydra_config: dict
    choices: dict
    overrides: list[str]
    started_in: Path | None
    status: dict
    metrics: dict

    @cached_property
    def checkpoint_path(self) -> Path:
        """Return the path of the best or the last checkpoint; raise MissingError without one."""
        for name in ("best", "last"):
            path = self.folder / "checkpoints" / f"{name}.ckpt"
            if path.is_file():
                return path
        raise MissingError(
            "The run has no checkpoint: it stopped before the end of its first epoch."
        )

    @cached_property
    def checkpoint(self) -> "Checkpoint":
        """Load the checkpoint; raise MissingError if it is missing or damaged."""
        from zoo.checkpoints.checkpoint import load_checkpoint

        try:
            return load_checkpoint(self.checkpoint_path)
        except InputError as error:
            raise MissingError(f"The checkpoint cannot be read: {error}.") from None

    @cached_property
    def config(self) -> dict:
        """Return the checkpoint's config, which names the recording in `data.root`, or Hydra's."""
        try:
            return self.checkpoint.config
        except MissingError:
            return self.hydra_config

    @cached_property
    def recording(self) -> "Recording":
        """Read the recording again; raise MissingError if it cannot be read."""
        from datamodules.recording import read_recordings

        root, images = self.config["data"]["root"], self.config["data"].get("images")
        if root is None:
            raise MissingError("The run stopped before it opened its recording.")
        roots = [self._found(one) for one in ([root] if isinstance(root, str) else root)]
        try:
            return read_recordings(roots, self._found(images) if images else None, "skip")
        except (InputError, OSError) as error:
            raise MissingError(f"The recording cannot be read: {error}.") from None

    @cached_property
    def drives(self) -> list["Drive"]:
        """Return the scored drives by track and start seed, without damaged ones."""
        return self._read_drives[0]

    @property
    def damaged_drives(self) -> list[str]:
        """Return a line for each damaged drive."""
        return self._read_drives[1]

    @cached_property
    def _read_drives(self) -> tuple[list["Drive"], list[str]]:
        from zoo.drives.drive_log import LOG_NAME, read_drive

        found, damaged = [], []
        for path in sorted(self.folder.glob(f"drives/*/{LOG_NAME}")):
            try:
                found.append(read_drive(path.parent))
            except InputError as error:
                damaged.append(str(error))
        needed = ("track", "seed", "autonomy", "cte_max_m")
        complete = [
            one
            for one in found
            if len(one) and all(one.summary.get(key) is not None for key in needed)
        ]
        return sorted(
            complete, key=lambda one: (one.summary["track"], one.summary["seed"])
        ), damaged

    @cached_property
    def tracks(self) -> dict[str, dict]:
        """Return every track's figures (see `mean_and_spread`); empty without drives."""
        from zoo.evaluate.drives_table import mean_and_spread

        scored = self.metrics.get("drive") or {}
        if scored.get("tracks"):
            return {name: one for name, one in scored["tracks"].items() if one}
        names = dict.fromkeys(one.summary["track"] for one in self.drives)
        return {
            name: mean_and_spread([d.summary for d in self.drives if d.summary["track"] == name])
            for name in names
        }

    def farthest_m(self, track: str) -> float:
        """Return the largest cross-track error of a track's drives, in metres."""
        own = [one.summary["cte_max_m"] for one in self.drives if one.summary["track"] == track]
        return max(own, default=self.tracks[track]["cte_max_m"][0])

    @cached_property
    def ended_early(self) -> str | None:
        """Return a sentence on why there are no figures; None for a finished run."""
        state = self.status.get("status")
        reason = self.status.get("reason") or "the reason was not saved"
        if state in ("failed", "pruned"):
            end = "failed" if state == "failed" else "was pruned by a search"
            return f"The run {end}: {reason}."
        if self.metrics:  # the run itself may write this report before it ends
            return None
        if state == "running" and is_alive(self.folder):
            return "The run is still running."
        return "The run did not finish: its process was killed."

    def figures(self, key: str) -> Any:
        """Return a value of `metrics.json`; raise MissingError if it is not there."""
        if not self.metrics:
            raise MissingError("metrics.json is missing: only a finished run has figures.")
        if self.metrics.get(key) is None:
            raise MissingError(f"metrics.json does not contain {key}.")
        return self.metrics[key]

    def plot(self, name: str, caption: str, why_not: str) -> Image:
        """Return a plot of the run; raise MissingError with `why_not` if it is missing."""
        path = self.folder / "plots" / f"{name}.png"
        if not path.is_file():
            raise MissingError(why_not)
        return Image(path.name, path.read_bytes(), caption, plot=True)

    def _found(self, place: str) -> str:
        """Return a path of the run's config, relative to the folder where the run was started."""
        path = Path(place).expanduser()
        if not path.exists() and self.started_in and (self.started_in / path).exists():
            return str(self.started_in / path)
        return str(path)


def read_run(folder: Path) -> Run:
    """Read the small files of a run; the other files are read on first use.

    Raises:
        InputError: the folder does not exist or is not a run's, or a file in it is damaged.
    """
    if not folder.is_dir():
        found = "is not a folder" if folder.exists() else "no such folder"
        raise InputError(f"{folder}: {found}; name a run's folder, such as outputs/DATE/TIME")
    if (folder / "multirun.yaml").is_file():
        jobs = sorted(path.parent.parent for path in folder.glob("*/.hydra/config.yaml"))
        hint = f"name one of its runs, such as {jobs[0]}" if jobs else "it has no runs to report"
        raise InputError(f"{folder}: is a sweep's folder; {hint}")
    if not (folder / ".hydra" / "config.yaml").is_file():
        raise InputError(
            f"{folder}: is not a run's folder (no .hydra/config.yaml); name one, such as "
            "outputs/DATE/TIME"
        )
    from zoo.runs.config_files import Runtime, load_config, read_hydra_file, read_overrides_file
    from zoo.runs.metrics_file import read_metrics_file
    from zoo.runs.status_file import read_status_file

    runtime = read_hydra_file(folder) if _has(folder, ".hydra/hydra.yaml") else Runtime()
    config = OmegaConf.to_container(load_config(folder), resolve=False)
    if not isinstance(config.get("data"), dict) or not isinstance(config.get("model"), dict):
        raise InputError(
            f"{folder}: is not a run of drivezoo train (its config has no data or no model); name "
            "another run"
        )
    return Run(
        folder=folder,
        hydra_config=config,
        choices=runtime.choices.model_dump(),
        overrides=read_overrides_file(folder) if _has(folder, ".hydra/overrides.yaml") else [],
        started_in=Path(runtime.cwd) if runtime.cwd else None,
        status=read_status_file(folder),
        metrics=read_metrics_file(folder) if _has(folder, "metrics.json") else {},
    )


def _has(folder: Path, name: str) -> bool:
    return (folder / name).exists()

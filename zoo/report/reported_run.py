"""A run's folder, as its write-up reads it."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omegaconf import OmegaConf

from datamodules.errors import InputError
from zoo.report.blocks import MissingError, Picture
from zoo.runs.status import is_alive

if TYPE_CHECKING:
    from datamodules.recording import Recording
    from zoo.checkpoints.checkpoint import Checkpoint
    from zoo.drives.drive_record import Drive


@dataclass(frozen=True)
class Run:
    """What a run left.

    Attributes:
        folder: the run's.
        hydra_config: its config as it was composed.
        choices: by config group, what was chosen.
        overrides: what was typed after `python -m zoo`.
        started_in: the folder that relative paths count from; None where that was not kept.
        status: what `status.json` holds.
        metrics: what `metrics.json` holds; empty before the run has finished.
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
        """The best checkpoint, or the last; MissingError without one."""
        for name in ("best", "last"):
            path = self.folder / "checkpoints" / f"{name}.ckpt"
            if path.is_file():
                return path
        raise MissingError("The run left no checkpoint: it ended before its first epoch did.")

    @cached_property
    def checkpoint(self) -> "Checkpoint":
        """Loaded; MissingError where there is none or it cannot be read."""
        from zoo.checkpoints.checkpoint import load_checkpoint

        try:
            return load_checkpoint(self.checkpoint_path)
        except InputError as error:
            raise MissingError(f"The checkpoint cannot be read: {error}.") from None

    @cached_property
    def config(self) -> dict:
        """The checkpoint's config, where `data.root` is what was trained on; else Hydra's."""
        try:
            return self.checkpoint.config
        except MissingError:
            return self.hydra_config

    @cached_property
    def recording(self) -> "Recording":
        """Read again; MissingError where it is no longer to be found."""
        from datamodules.recording import read_recordings

        root, images = self.config["data"]["root"], self.config["data"].get("images")
        if root is None:
            raise MissingError("The run ended before it knew its recording.")
        roots = [self._found(one) for one in ([root] if isinstance(root, str) else root)]
        try:
            return read_recordings(roots, self._found(images) if images else None, "skip")
        except (InputError, OSError) as error:
            raise MissingError(f"The recording cannot be read any more: {error}.") from None

    @cached_property
    def drives(self) -> list["Drive"]:
        """The scored drives, by track and start seed; one that is damaged is left out."""
        return self._read_drives[0]

    @property
    def damaged_drives(self) -> list[str]:
        """What is wrong with those drives that cannot be read, a line each."""
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
        """Every track's figures, see `mean_and_spread`; empty where nothing drove."""
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
        """How far off a track's centreline any of its drives came, in metres."""
        own = [one.summary["cte_max_m"] for one in self.drives if one.summary["track"] == track]
        return max(own, default=self.tracks[track]["cte_max_m"][0])

    @cached_property
    def ended_early(self) -> str | None:
        """Why there are no figures, as a sentence; None for a run that has finished."""
        state = self.status.get("status")
        reason = self.status.get("reason") or "the reason was not kept"
        if state in ("failed", "pruned"):
            what = "failed" if state == "failed" else "was given up by a search"
            return f"The run {what}: {reason}."
        if self.metrics:  # this may be written while the run's last lines are
            return None
        if state == "running" and is_alive(self.folder):
            return "The run is still going on."
        return "The run did not finish: its process was ended from outside."

    def figures(self, key: str) -> Any:
        """Of `metrics.json`; MissingError before the run has finished, or without such figures."""
        if not self.metrics:
            raise MissingError("There is no metrics.json: only a finished run has figures.")
        if self.metrics.get(key) is None:
            raise MissingError(f"metrics.json holds no {key}.")
        return self.metrics[key]

    def plot(self, name: str, caption: str, why_not: str) -> Picture:
        """A plot that the run drew; MissingError, with the reason, where it did not."""
        path = self.folder / "plots" / f"{name}.png"
        if not path.is_file():
            raise MissingError(why_not)
        return Picture(path.name, path.read_bytes(), caption, plot=True)

    def _found(self, place: str) -> str:
        """A path as the run meant it."""
        path = Path(place).expanduser()
        if not path.exists() and self.started_in and (self.started_in / path).exists():
            return str(self.started_in / path)
        return str(path)


def read_run(folder: Path) -> Run:
    """Read what is small of a run; the rest when it is asked for.

    Raises:
        InputError: there is no such folder, it is no run's, or a file in it is damaged.
    """
    if not folder.is_dir():
        what = "is no folder" if folder.exists() else "no such folder"
        raise InputError(f"{folder}: {what}; name a run's, such as outputs/DATE/TIME")
    if (folder / "multirun.yaml").is_file():
        jobs = sorted(path.parent.parent for path in folder.glob("*/.hydra/config.yaml"))
        hint = f"; name one of its runs, such as {jobs[0]}" if jobs else ", without any run"
        raise InputError(f"{folder}: is a sweep's folder{hint}")
    if not (folder / ".hydra" / "config.yaml").is_file():
        raise InputError(f"{folder}: is no run's folder (it holds no .hydra/config.yaml)")
    from zoo.runs.config_files import Runtime, load_config, read_hydra_file, read_overrides_file
    from zoo.runs.metrics_file import read_metrics_file
    from zoo.runs.status_file import read_status_file

    runtime = read_hydra_file(folder) if _has(folder, ".hydra/hydra.yaml") else Runtime()
    config = OmegaConf.to_container(load_config(folder), resolve=False)
    if not isinstance(config.get("data"), dict) or not isinstance(config.get("model"), dict):
        raise InputError(f"{folder}: is no run of python -m zoo (its config has no data and model)")
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

"""Reading finished runs, grouping them by training seed, and ranking them, best driver first.

Sweeps and the leaderboard use it. Runs without a drive rank below all runs with one.
"""

import json
from collections.abc import Iterable, Sequence
from dataclasses import astuple, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from zoo.base.errors import InputError
from zoo.drives.drive_record import EMBEDDED, REPLAY, SOCKET
from zoo.drives.metrics import leaderboard_metrics
from zoo.evaluate.drives_table import mean_and_deviation
from zoo.runs.record_fields import Spread
from zoo.runs.status import is_alive, read_status
from zoo.runs.trained_recordings import TrainedOn, read_trained_on

if TYPE_CHECKING:
    from zoo.runs.config_files import Runtime

IGNORED_KEYS = ("seed",)  # runs whose configs differ only here are repeats
LAST = float("inf")  # sorts after every figure
BENCHMARK = "benchmark"  # source of drives on the roads of a suite
WHOLE_LAP = 0.95  # laps; a drive that ends a little before its start counts as a lap
LAP_M = 1000.0  # where the laps are unknown; the included circuits are longer
LENGTHS = ("laps", "driven_m", "driven_s")  # figures beside the leaderboard's metrics
CURVES = ("train/loss", "val/mse", "drive/autonomy", "drive/cte_mean", "drive/score")


@dataclass(frozen=True)
class Count:
    """A number of drives, and how many of them had no intervention."""

    without_intervention: int
    drives: int


@dataclass(frozen=True)
class Run:
    """A finished run, read from its folder; or a drive, see `zoo.leaderboard.ranked_drive`.

    Attributes:
        name: name of the experiment, or of the model.
        overrides: overrides that the user typed, by key, without those of Hydra itself.
        settings: config and recordings as text, without the training seed; equal for repeats.
        seed: training seed.
        trained_on: recordings of the training.
        autonomy, cte_m: means over the tracks (0..1, metres); None for a run without a drive.
        tracks: by track, the leaderboard's metrics and `driven_s`, each a mean over the drives.
        counts: by track, number of drives and of those without an intervention, where known.
        mph: speed that the controller held; None for the network's own throttle, or no drive.
        wall_s: seconds of training; None for a single drive.
        curves: by name (`val/mse`, `train/loss`, `drive/autonomy`), values by epoch from 1 on.
        source: source of the drives, as in `Drive`, or BENCHMARK; empty for a run without a drive.
    """

    folder: Path
    name: str
    overrides: dict[str, str]
    settings: str
    seed: int | None
    trained_on: TrainedOn
    parameters: int | None
    autonomy: float | None
    cte_m: float | None
    tracks: dict[str, dict[str, float]]
    counts: dict[str, Count]
    mph: float | None
    val_mse: float | None
    test_mse: float | None
    wall_s: float | None
    curves: dict[str, dict[int, float]] = field(repr=False)
    source: str = ""


@dataclass(frozen=True)
class Entry:
    """A row of the ranking: a run, or several that differ only in their training seed.

    Attributes:
        figures: by `autonomy`, `cte_m`, `val_mse`, ..., mean and sample deviation over the training
            seeds; by `TRACK/drives`, the `Count` of all drives. None where a run lacks the figure.
    """

    runs: tuple[Run, ...]
    figures: dict[str, Spread | Count | None]

    @property
    def first(self) -> Run:
        """Return the run with the lowest training seed."""
        return self.runs[0]

    def short_drive(self, track: str | None = None) -> str:
        """Return the length of the shortest drives of less than a lap, such as `0.1 laps`.

        Args:
            track: track of the drives; None for any.

        Returns:
            The length; empty if all drives are as long as a lap, or their length is unknown.
        """
        driven = [
            one for run in self.runs for name, one in run.tracks.items() if track in (None, name)
        ]
        laps = [one["laps"] for one in driven if "laps" in one]
        metres = [one["driven_m"] for one in driven if "laps" not in one and "driven_m" in one]
        if laps and min(laps) < WHOLE_LAP:
            return f"{min(laps):.2g} laps"
        return f"{min(metres):.0f} m" if metres and min(metres) < LAP_M else ""


@dataclass(frozen=True)
class Unranked:
    """A run without figures.

    Attributes:
        why: `running`, `stopped`, `failed`, `pruned`, `older` or `damaged`.
        reason: details, such as the line of the error.
    """

    folder: Path
    why: str
    reason: str = ""


def read_run(folder: Path) -> Run | None:
    """Return a finished run; None where its figures are damaged or of another version."""
    try:
        return load_run(folder)
    except InputError:
        return None


def load_run(folder: Path) -> Run | None:
    """Return a finished run; None where its figures are of another version.

    Raises:
        InputError: a file of the run is missing or cannot be read.
    """
    from zoo.runs.curves_files import read_curves
    from zoo.runs.metrics_file import read_metrics_file

    metrics = read_metrics_file(folder)
    open_loop = metrics.get("open_loop")
    if open_loop is None:
        return None
    tracks, mph = _driven(metrics.get("drive"))
    config, overrides, runtime = _configs(folder)
    trained_on = read_trained_on(config, runtime.cwd, metrics)
    return Run(
        folder=folder,
        name=runtime.choices.experiment or metrics.get("model") or "?",
        overrides=overrides,
        settings=_settings(config, trained_on),
        seed=metrics.get("seed"),
        trained_on=trained_on,
        parameters=metrics.get("parameters"),
        autonomy=mean_over_tracks(tracks, "autonomy"),
        cte_m=mean_over_tracks(tracks, "cte_mean_m"),
        tracks=track_means(tracks),
        counts=track_counts(tracks),
        mph=mph,
        val_mse=open_loop.get("val", {}).get("mse"),
        test_mse=open_loop.get("test", {}).get("mse"),
        wall_s=float(metrics.get("wall_s") or 0),
        curves=read_curves(folder, CURVES),
        source=EMBEDDED if tracks else "",
    )


def why_unranked(folder: Path) -> Unranked:
    """Return why a run has no figures to rank."""
    status = read_status(folder)
    state, reason = status.get("status"), str(status.get("reason", ""))
    if state == "running":
        return Unranked(folder, "running" if is_alive(folder) else "stopped")
    if state in ("failed", "pruned"):
        return Unranked(folder, state, reason)
    return Unranked(folder, "older")


def read_runs(folders: Iterable[Path]) -> tuple[list[Run], list[Unranked]]:
    """Return the runs that can be ranked, and the others with the reason."""
    from zoo.runs.status_file import read_status_file

    runs, unranked = [], []
    for folder in folders:
        try:
            status = read_status_file(folder)
            # A finished run that is being resumed keeps the figures of its finished epochs.
            has_figures = status.get("status") == "finished" or "finished_epochs" in status
            run = load_run(folder) if has_figures else None
        except InputError as error:
            reason = str(error).removeprefix(f"{folder}/")
            unranked.append(Unranked(folder, "damaged", reason))
            continue
        if run is None:
            unranked.append(why_unranked(folder))
        else:
            runs.append(run)
    return runs, unranked


def rank(runs: Sequence[Run]) -> list[Entry]:
    """Sort runs by autonomy, then cross-track error, then validation MSE.

    Drives of less than a lap come after all that are longer: most roads are easy at their start.
    Repeats with other training seeds form one entry. Where runs were driven on different tracks,
    only the tracks that all of them share count.
    """
    groups: dict[str, list[Run]] = {}
    for run in runs:
        groups.setdefault(run.settings, []).append(run)
    shared = shared_tracks(runs)
    entries = [_entry(group, shared) for group in groups.values()]
    return sorted(entries, key=_order)


def shared_tracks(runs: Sequence[Run]) -> list[str]:
    """Return the tracks on which every run with a drive was driven."""
    driven = [run.tracks for run in runs if run.tracks]
    return [name for name in (driven[0] if driven else {}) if all(name in one for one in driven)]


def protocols(runs: Sequence[Run]) -> list[str]:
    """Return descriptions of how the runs were driven; none where it is the same for all."""
    found = {f"{', '.join(run.tracks)} {_conditions(run)}" for run in runs if run.tracks}
    return sorted(found) if len(found) > 1 else []


def _conditions(run: Run) -> str:
    """Return where a run was driven, and at what speed."""
    if run.source == REPLAY:
        return "in a replay"
    if run.source == BENCHMARK:
        return "in the benchmark"
    how = f"at {run.mph:g} mph" if run.mph else "with its own throttle"
    if not run.mph and run.val_mse is None:
        how = "at a speed that its file does not name"  # an evaluation
    return f"on a socket {how}" if run.source == SOCKET else how


def _driven(drive: dict | None) -> tuple[dict[str, dict], float | None]:
    """Return figures by track, and the speed; both empty for a score of another format."""
    if not drive or not drive.get("tracks"):
        return {}, None
    tracks = {name: one for name, one in drive["tracks"].items() if one}
    for name, one in tracks.items():
        for key in ("autonomy", "cte_mean_m"):
            if key not in one:
                raise InputError(f"metrics.json: drive.tracks.{name}.{key}: is missing")
    return tracks, drive.get("speed_mph")


def track_means(tracks: dict[str, dict]) -> dict[str, dict[str, float]]:
    """Return the leaderboard's metrics by track, without the deviations."""
    shown = (*_shown_metrics(), *LENGTHS)
    return {
        name: {key: float(one[key][0]) for key in shown if one.get(key)}
        for name, one in tracks.items()
    }


def track_counts(tracks: dict[str, dict]) -> dict[str, Count]:
    """Return by track how many drives there were, where it is known."""
    return {
        name: Count(one["drives_without_intervention"], one["drives"])
        for name, one in tracks.items()
        if one.get("drives_without_intervention") is not None
    }


def mean_over_tracks(tracks: dict[str, dict], key: str) -> float | None:
    """Return the mean of a metric over the tracks, or None where none has it."""
    values = [float(one[key][0]) for one in tracks.values() if one.get(key)]
    return float(np.mean(values)) if values else None


def _entry(runs: Sequence[Run], shared: Sequence[str]) -> Entry:
    runs = sorted(runs, key=lambda run: (run.seed is None, run.seed))
    figures = {
        key: _spread([getattr(run, key) for run in runs])
        for key in ("val_mse", "test_mse", "wall_s")
    }
    for key, track_key in (("autonomy", "autonomy"), ("cte_m", "cte_mean_m")):
        values = [_over_tracks(run, shared, track_key) for run in runs]
        figures[key] = _spread(values)
    for track in dict.fromkeys(name for run in runs for name in run.tracks):
        for key in (*_shown_metrics(), *LENGTHS[:2]):
            values = [run.tracks.get(track, {}).get(key) for run in runs]
            figures[f"{track}/{key}"] = _spread(values)
        counts = [run.counts.get(track) for run in runs]
        figures[f"{track}/drives"] = None
        if all(counts):
            totals = (sum(column) for column in zip(*map(astuple, counts), strict=True))
            figures[f"{track}/drives"] = Count(*totals)
    return Entry(tuple(runs), figures)


def _shown_metrics() -> list[str]:
    return [one.name for one in leaderboard_metrics()]


def _over_tracks(run: Run, shared: Sequence[str], key: str) -> float | None:
    tracks = [one for name, one in run.tracks.items() if not shared or name in shared]
    values = [one[key] for one in tracks if key in one]  # null where nothing was driven
    return float(np.mean(values)) if values and len(values) == len(tracks) else None


def _spread(values: Sequence[float | None]) -> Spread | None:
    if not values or any(value is None for value in values):
        return None
    return mean_and_deviation(values)


def _order(entry: Entry) -> tuple:
    autonomy, cte, mse = (entry.figures[key] for key in ("autonomy", "cte_m", "val_mse"))
    return (
        autonomy is None,
        bool(entry.short_drive()),
        -autonomy[0] if autonomy else LAST,
        cte[0] if cte else LAST,
        mse[0] if mse else LAST,
        str(entry.first.folder),
    )


def _settings(config: dict, trained_on: TrainedOn) -> str:
    """Return config and recordings as text, equal for repeats of a run."""
    data = config.get("data")
    # The fingerprint identifies a recording; its path may be written in several ways.
    if isinstance(data, dict):
        config = config | {"data": {key: data[key] for key in data if key != "root"}}
    return json.dumps([config, *astuple(trained_on)], sort_keys=True)


def _configs(folder: Path) -> tuple[dict, dict[str, str], "Runtime"]:
    """Return the config without ignored keys, the typed overrides by key, and Hydra's record."""
    from zoo.runs.config_files import read_config_file, read_hydra_file, read_overrides_file

    config, overrides = read_config_file(folder), read_overrides_file(folder)
    for key in IGNORED_KEYS:
        config.pop(key, None)
    # A search adds this callback to each trial; it holds the trial's number.
    if isinstance(config.get("callbacks"), dict):
        config["callbacks"].pop("pruning", None)
    pairs = [one.lstrip("+~").partition("=") for one in overrides]
    words = ("true", "false", "null")  # which Hydra takes in capitals, too
    pairs = [(key, one.lower() if one.lower() in words else one) for key, _, one in pairs]
    typed = {key: value for key, value in pairs if not key.startswith(("hydra", "callbacks.pr"))}
    return config, typed, read_hydra_file(folder)

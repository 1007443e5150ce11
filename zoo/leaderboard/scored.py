"""What is ranked, read from its folder: a run, evaluation, result of the benchmark or drive."""

import json
import math
from collections.abc import Iterable
from dataclasses import astuple, dataclass, field
from pathlib import Path

import numpy as np

from zoo.base.errors import InputError
from zoo.drives.drive_log import LOG_NAME, SUMMARY_NAME, read_drive, read_summary
from zoo.drives.drive_record import EMBEDDED
from zoo.drives.metrics import METRICS, leaderboard_metrics, measure
from zoo.runs.metrics_file import NAME as METRICS_NAME
from zoo.runs.metrics_file import read_metrics_file
from zoo.runs.run import Run, TrainedOn

BENCHMARK = "benchmark"  # source of drives on the roads of a suite
UNKNOWN = "unknown track"
LENGTHS = ("laps", "driven_m", "driven_s")  # figures beside the leaderboard's metrics
CURVES = ("train/loss", "val/mse", "drive/autonomy", "drive/cte_mean", "drive/score")
IGNORED_KEYS = ("seed",)  # runs whose configs differ only here are repeats


@dataclass(frozen=True)
class Count:
    """A number of drives, and how many of them had no intervention."""

    without_intervention: int
    drives: int


@dataclass(frozen=True)
class Scored:
    """What is ranked: a finished run, an evaluation, a result of the benchmark or a drive.

    Attributes:
        name: name of the experiment, of the model or of the checkpoint.
        settings: config and recordings as text, without the training seed; equal for repeats.
        autonomy, cte_m: means over the tracks (0..1, metres); None without a drive.
        tracks: by track, the leaderboard's metrics and `LENGTHS`, each a mean over the drives.
        counts: by track, number of drives and of those without an intervention, where known.
        source: source of the drives, as in `Drive`, or BENCHMARK; empty without a drive.
        mph: speed that the controller held; None for the network's own throttle, or no drive.
        overrides: overrides that the user typed, by key, without those of Hydra itself.
        seed: training seed.
        trained_on: recordings of the training.
        wall_s: seconds of training; None for what is not a run.
        curves: by name (`val/mse`, `train/loss`, `drive/autonomy`), values by epoch from 1 on.
    """

    folder: Path
    name: str
    settings: str
    autonomy: float | None
    cte_m: float | None
    tracks: dict[str, dict[str, float]]
    counts: dict[str, Count]
    source: str
    mph: float | None = None
    overrides: dict[str, str] = field(default_factory=dict)
    seed: int | None = None
    trained_on: TrainedOn = field(default_factory=TrainedOn)
    val_mse: float | None = None
    test_mse: float | None = None
    wall_s: float | None = None
    curves: dict[str, dict[int, float]] = field(default_factory=dict, repr=False)


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


def read_scored(
    runs: Iterable[Path], drives: Iterable[Path] = ()
) -> tuple[list[Scored], list[Unranked]]:
    """Return what can be ranked, and the other folders with the reason.

    Args:
        runs: folders of runs.
        drives: folders of drives, evaluations and results of the benchmark.
    """
    scored, unranked = [], []
    jobs = [(folder, _ranked_run) for folder in runs]
    jobs += [(folder, load_scored) for folder in drives]
    for folder, load in jobs:
        try:
            found = load(folder)
        except InputError as error:
            found = Unranked(folder, "damaged", str(error).removeprefix(f"{folder}/"))
        (unranked if isinstance(found, Unranked) else scored).append(found)
    return scored, unranked


def _ranked_run(folder: Path) -> Scored | Unranked:
    run = Run(folder)
    # A finished run that is being resumed keeps the figures of its finished epochs.
    has_figures = run.state == "finished" or "finished_epochs" in run.status
    if has_figures and (scored := load_run(folder)) is not None:
        return scored
    if run.state in ("running", "stopped", "failed", "pruned"):
        reason = run.status.get("reason") if run.state in ("failed", "pruned") else ""
        return Unranked(folder, run.state, str(reason or ""))
    return Unranked(folder, "older")


def finished_run(folder: Path) -> Scored | None:
    """Return a finished run; None where it has no figures or they are damaged."""
    try:
        return load_run(folder)
    except InputError:
        return None


def load_run(folder: Path) -> Scored | None:
    """Return a finished run; None where it has no open-loop figures.

    Raises:
        InputError: a file of the run is missing or cannot be read.
    """
    metrics = read_metrics_file(folder)
    open_loop = metrics.get("open_loop")
    if open_loop is None:
        return None
    run, drive = Run(folder), metrics.get("drive") or {}
    tracks = run.tracks
    for name, one in tracks.items():
        for key in ("autonomy", "cte_mean_m"):
            if key not in one:
                raise InputError(f"metrics.json: drive.tracks.{name}.{key}: is missing")
    return Scored(
        folder=folder,
        name=run.choices["experiment"] or metrics.get("model") or "?",
        settings=_settings(run),
        source=EMBEDDED if tracks else "",
        **_of_tracks(tracks),
        mph=drive.get("speed_mph") if tracks else None,
        overrides=_typed(run),
        seed=metrics.get("seed"),
        trained_on=run.trained_on,
        val_mse=open_loop.get("val", {}).get("mse"),
        test_mse=open_loop.get("test", {}).get("mse"),
        wall_s=float(metrics.get("wall_s") or 0),
        curves=run.curves(CURVES),
    )


def load_scored(folder: Path) -> Scored:
    """Return a drive, a result of the benchmark or an evaluation.

    Raises:
        InputError: a file of the folder cannot be read.
    """
    if is_drive(folder):
        return load_drive(folder)
    return load_benchmark(folder) if is_benchmark(folder) else load_evaluation(folder)


def load_drive(folder: Path) -> Scored:
    """Return a drive.

    Figures missing from `drive.json`, as after an interrupted drive, are computed from the log.

    Raises:
        InputError: a file of the drive cannot be read.
    """
    path = folder / SUMMARY_NAME
    summary = read_summary(path) if path.is_file() else {}
    shown = _shown()
    if any(name not in summary for name in shown):
        summary = measure(read_drive(folder)) | summary
    figures = {
        name: float(summary[name])
        for name in METRICS
        if name in shown and summary.get(name) is not None and math.isfinite(summary[name])
    }
    track = summary.get("track") or ", ".join(summary.get("recording") or []) or UNKNOWN
    counts = {}
    if "autonomy" in figures:
        counts[track] = Count(int(not figures["interventions"]), 1)
    return Scored(
        folder=folder,
        name=str(summary.get("checkpoint") or "-"),
        settings=f"the drive in {folder.resolve()}",  # unique: no other drive repeats it
        autonomy=figures.get("autonomy"),
        cte_m=figures.get("cte_mean_m"),
        tracks={track: figures},
        counts=counts,
        source=summary.get("drive") or "",
        mph=summary.get("set_mph"),
    )


def load_evaluation(folder: Path) -> Scored:
    """Return the means over an evaluation's drives.

    Raises:
        InputError: `metrics.json` cannot be read.
    """
    metrics = read_metrics_file(folder)
    tracks = {name: one for name, one in (metrics.get("tracks") or {}).items() if one}
    return Scored(
        folder=folder,
        name=str(metrics.get("checkpoint") or "-"),
        settings=f"the evaluation in {folder.resolve()}",  # unique: no other one repeats it
        source=EMBEDDED,
        **_of_tracks(tracks),
    )


def load_benchmark(folder: Path) -> Scored:
    """Return the figures of an entry of the benchmark.

    Its autonomy is the headline: the interquartile mean over all roads but the laps. The suite with
    the digest of its roads stands for the track.

    Raises:
        InputError: `result.json` cannot be read.
    """
    from zoo.benchmark.checked_result import read_result
    from zoo.benchmark.suite import LAPS

    result = read_result(folder)
    drives = [one.figures for one in result.drives if one.group != LAPS]
    drives = drives or [one.figures for one in result.drives]
    figures = {
        name: sum(float(one[name] or 0) for one in drives) / len(drives)
        for name in ("cte_mean_m", "interventions", "driven_s")
    }
    if result.headline.value is not None:
        figures["autonomy"] = result.headline.value
    suite = f"{result.suite} {result.roads[:6]}"
    clean = sum(not one["interventions"] for one in drives)
    return Scored(
        folder=folder,
        name=result.entry,
        settings=f"the benchmark in {folder.resolve()}",  # unique: no other one repeats it
        autonomy=figures.get("autonomy"),
        cte_m=figures["cte_mean_m"],
        tracks={suite: figures},
        counts={suite: Count(clean, len(drives))},
        source=BENCHMARK,
    )


def is_benchmark(folder: Path) -> bool:
    """Return whether `drivezoo benchmark` wrote a folder."""
    return (folder / "result.json").is_file()


def is_evaluation(folder: Path) -> bool:
    """Return whether `drivezoo evaluate` wrote a folder; True if its figures are damaged."""
    if not (folder / METRICS_NAME).is_file():
        return False
    try:
        return bool(read_metrics_file(folder).get("tracks"))
    except InputError:
        return True


def is_drive(folder: Path) -> bool:
    """Return whether a folder holds a drive."""
    return (folder / LOG_NAME).is_file()


def _shown() -> list[str]:
    """Return the names of the figures of a track that are read."""
    return [*(one.name for one in leaderboard_metrics()), *LENGTHS]


def _of_tracks(tracks: dict[str, dict]) -> dict:
    """Return the fields of `Scored` that follow from the figures of tracks, without deviations."""
    means = {
        name: {key: float(one[key][0]) for key in _shown() if one.get(key)}
        for name, one in tracks.items()
    }
    counts = {
        name: Count(one["drives_without_intervention"], one["drives"])
        for name, one in tracks.items()
        if one.get("drives_without_intervention") is not None and one.get("drives") is not None
    }
    overall = {}
    for field_name, key in (("autonomy", "autonomy"), ("cte_m", "cte_mean_m")):
        values = [one[key] for one in means.values() if key in one]
        overall[field_name] = float(np.mean(values)) if values else None
    return {"tracks": means, "counts": counts, **overall}


def _settings(run: Run) -> str:
    """Return config and recordings as text, equal for repeats of a run."""
    config = {key: value for key, value in run.config.items() if key not in IGNORED_KEYS}
    # A search adds this callback to each trial; it holds the trial's number.
    # The fingerprint identifies a recording; its path may be written in several ways.
    for section, ignored in (("callbacks", "pruning"), ("data", "root")):
        if isinstance(inner := config.get(section), dict):
            config[section] = {key: value for key, value in inner.items() if key != ignored}
    return json.dumps([config, *astuple(run.trained_on)], sort_keys=True)


def _typed(run: Run) -> dict[str, str]:
    """Return the typed overrides by key."""
    words = ("true", "false", "null")  # which Hydra takes in capitals, too
    pairs = [one.lstrip("+~").partition("=") for one in run.overrides]
    return {
        key: value.lower() if value.lower() in words else value
        for key, _, value in pairs
        if not key.startswith(("hydra", "callbacks.pr"))
    }

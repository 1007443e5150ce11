"""Evaluations, results of the benchmark and single drives as entries of the ranking.

An evaluation is a folder of `drivezoo evaluate`; a drive is from a socket, the embedded world
or a replay.
"""

import math
from collections.abc import Iterable
from pathlib import Path

from zoo.base.errors import InputError
from zoo.drives.drive_log import LOG_NAME, SUMMARY_NAME, read_drive, read_summary
from zoo.drives.drive_record import EMBEDDED
from zoo.drives.metrics import METRICS, leaderboard_metrics, measure
from zoo.leaderboard.ranking import (
    BENCHMARK,
    LENGTHS,
    Count,
    Run,
    Unranked,
    mean_over_tracks,
    track_counts,
    track_means,
)
from zoo.runs.metrics_file import NAME as METRICS_NAME
from zoo.runs.metrics_file import read_metrics_file
from zoo.runs.trained_recordings import TrainedOn

UNKNOWN = "unknown track"


def read_drives(folders: Iterable[Path]) -> tuple[list[Run], list[Unranked]]:
    """Return drives, evaluations and results of the benchmark, and damaged ones with the reason."""
    found, unranked = [], []
    for folder in folders:
        try:
            if is_drive(folder):
                found.append(load_drive(folder))
            else:
                load = load_benchmark if is_benchmark(folder) else load_evaluation
                found.append(load(folder))
        except InputError as error:
            reason = str(error).removeprefix(f"{folder}/")
            unranked.append(Unranked(folder, "damaged", reason))
    return found, unranked


def load_drive(folder: Path) -> Run:
    """Return a drive in the form of a ranked run.

    Figures missing from `drive.json`, as after an interrupted drive, are computed from the log.

    Raises:
        InputError: a file of the drive cannot be read.
    """
    path = folder / SUMMARY_NAME
    summary = read_summary(path) if path.is_file() else {}
    shown = [*(one.name for one in leaderboard_metrics()), *LENGTHS]
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
    return Run(
        folder=folder,
        name=str(summary.get("checkpoint") or "-"),
        overrides={},
        settings=f"the drive in {folder.resolve()}",  # unique: no other drive repeats it
        seed=None,
        trained_on=TrainedOn(),
        parameters=None,
        autonomy=figures.get("autonomy"),
        cte_m=figures.get("cte_mean_m"),
        tracks={track: figures},
        counts=counts,
        mph=summary.get("set_mph"),
        val_mse=None,
        test_mse=None,
        wall_s=None,
        curves={},
        source=summary.get("drive") or "",
    )


def load_evaluation(folder: Path) -> Run:
    """Return the means over an evaluation's drives, in the form of a ranked run.

    Raises:
        InputError: `metrics.json` cannot be read.
    """
    metrics = read_metrics_file(folder)
    tracks = {name: one for name, one in (metrics.get("tracks") or {}).items() if one}
    return Run(
        folder=folder,
        name=str(metrics.get("checkpoint") or "-"),
        overrides={},
        settings=f"the evaluation in {folder.resolve()}",  # unique: no other one repeats it
        seed=None,
        trained_on=TrainedOn(),
        parameters=None,
        autonomy=mean_over_tracks(tracks, "autonomy"),
        cte_m=mean_over_tracks(tracks, "cte_mean_m"),
        tracks=track_means(tracks),
        counts=track_counts(tracks),
        mph=None,
        val_mse=None,
        test_mse=None,
        wall_s=None,
        curves={},
        source=EMBEDDED,
    )


def load_benchmark(folder: Path) -> Run:
    """Return the figures of an entry of the benchmark, in the form of a ranked run.

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
    return Run(
        folder=folder,
        name=result.entry,
        overrides={},
        settings=f"the benchmark in {folder.resolve()}",  # unique: no other one repeats it
        seed=None,
        trained_on=TrainedOn(),
        parameters=None,
        autonomy=figures.get("autonomy"),
        cte_m=figures["cte_mean_m"],
        tracks={suite: figures},
        counts={suite: Count(clean, len(drives))},
        mph=None,
        val_mse=None,
        test_mse=None,
        wall_s=None,
        curves={},
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

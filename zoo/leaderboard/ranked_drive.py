"""Evaluations and single drives as entries of the ranking.

An evaluation is a folder of `drivezoo evaluate`; a drive is from a socket, the embedded world
or a replay.
"""

import math
from collections.abc import Iterable
from pathlib import Path

from datamodules.errors import InputError
from zoo.drives.drive_log import LOG_NAME, SUMMARY_NAME, read_drive
from zoo.drives.drive_record import EMBEDDED
from zoo.drives.metrics import METRICS, leaderboard_metrics, measure
from zoo.leaderboard.ranking import (
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
    """Return drives and evaluations that can be ranked, and damaged ones with the reason."""
    found, unranked = [], []
    for folder in folders:
        try:
            found.append(load_drive(folder) if is_drive(folder) else load_evaluation(folder))
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
    from zoo.drives.drive_file import read_summary_file

    path = folder / SUMMARY_NAME
    summary = read_summary_file(path) if path.is_file() else {}
    shown = [*(one.name for one in leaderboard_metrics()), "driven_s"]
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

"""Plots of drives: path on the track, cross-track error, curves over perturbations."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from zoo.base.file_text import plot_text
from zoo.base.rig import MPS_PER_MPH
from zoo.driving.drive_record import Drive
from zoo.runs.plots import BLUE, GREY, ORANGE, NotebookFigure
from zoo.simulator.track import Track


def road_line(track: Track) -> np.ndarray:
    """Return the points of a track's centre, a closed one's first point again, [N, 2], m."""
    return np.vstack([track.xyz, track.xyz[: int(track.closed)]])[:, :2]


def birds_eye(track: Track, way: np.ndarray, drive: Drive, title: str) -> Figure:
    """Draw the car's path on the track, coloured by cross-track error, with interventions.

    Args:
        track: track of the drive.
        way: path, [N, 2], m.
        drive: errors and interventions.
        title: title of the figure.
    """
    road = road_line(track)
    extent = np.maximum(np.ptp(road, axis=0), 1.0)
    width, height = extent * min(5.2 / extent)  # inches, without colour bar and title
    figure = NotebookFigure(
        figsize=(max(width, 3) + 1.8, max(height, 2) + 0.9), layout="constrained"
    )
    axis = figure.subplots()
    axis.plot(road[:, 0], road[:, 1], color=GREY, lw=7, alpha=0.25, solid_capstyle="round")
    error = np.abs(drive.cross_track_m)
    steps = list(np.stack([way[:-1], way[1:]], 1))
    lines = LineCollection(steps, array=error[1:], cmap="viridis", lw=2.2)
    lines.set_clim(0, max(1.0, drive.lane_m / 2))
    axis.add_collection(lines)
    figure.colorbar(lines, ax=axis, label="cross-track error (m)", shrink=0.7, extend="max")
    lost = drive.intervention
    if lost.any():
        axis.scatter(way[lost, 0], way[lost, 1], marker="x", s=70, color=ORANGE, lw=2.5, zorder=3)
    axis.plot(*way[0], marker="o", color="black", ms=6, zorder=3)
    axis.annotate("start", way[0], xytext=(6, 6), textcoords="offset points")
    axis.set(aspect="equal", xlabel="m", ylabel="m", title=plot_text(title))
    axis.autoscale_view()
    axis.spines[["top", "right"]].set_visible(False)
    return figure


def error_over_distance(drive: Drive, title: str) -> Figure:
    """Draw the cross-track error along the drive, positive right, with the limits of the lane."""
    figure = NotebookFigure(figsize=(8, 3), layout="constrained")
    axis = figure.subplots()
    if drive.distance_m is None:  # a world that does not know it
        step = np.diff(drive.time_s, prepend=drive.time_s[0]) * drive.speed_mph * MPS_PER_MPH
    else:
        step = np.diff(drive.distance_m, prepend=drive.distance_m[0])
    if math.isfinite(drive.length_m):  # a lap begins at 0 again
        step = (step + drive.length_m / 2) % drive.length_m - drive.length_m / 2
    driven = np.cumsum(np.abs(step))
    error = drive.cross_track_m
    lost = drive.intervention
    axis.axhspan(-drive.lane_m, drive.lane_m, color=GREY, alpha=0.12, lw=0)
    axis.axhline(0, color=GREY, lw=0.8)
    axis.plot(driven, np.where(np.roll(lost, 1), np.nan, error), color=BLUE, lw=1.2)
    axis.scatter(driven[lost], error[lost], marker="x", color=ORANGE, lw=2, label="intervention")
    if lost.any():
        axis.legend(frameon=False)
    axis.set(xlabel="distance driven (m)", ylabel="cross-track error (m, + right)")
    axis.set_title(plot_text(title))
    axis.margins(x=0)
    axis.spines[["top", "right"]].set_visible(False)
    return figure


def figures_by_track(drives: Sequence[Mapping]) -> Figure:
    """Draw autonomy and mean cross-track error of each drive, and their means, by track.

    Args:
        drives: figures of each drive, with `track`; a figure that is None leaves a gap.
    """
    tracks = list(dict.fromkeys(str(drive["track"]) for drive in drives))
    figure = NotebookFigure(figsize=(7, 0.9 + 0.45 * len(tracks)), layout="constrained")
    axes = figure.subplots(1, 2, sharey=True)
    panels = (("autonomy", 100, "autonomy (%)"), ("cte_mean_m", 1, "mean cross-track error (m)"))
    for axis, (key, factor, label) in zip(axes, panels, strict=True):
        for row, track in enumerate(tracks):
            values = np.array([drive[key] for drive in drives if drive["track"] == track], float)
            axis.plot(factor * values, [row] * len(values), "o", color=BLUE, alpha=0.5, mew=0)
            axis.plot(factor * np.mean(values), row, marker="|", ms=16, mew=2, color=ORANGE)
        axis.set(xlabel=label, ylim=(len(tracks) - 0.5, -0.5))
        axis.set_yticks(range(len(tracks)), map(plot_text, tracks))
        axis.grid(axis="x", alpha=0.2)
        axis.spines[["top", "right"]].set_visible(False)
    axes[0].set_xlim(-4, 104)
    axes[1].set_xlim(left=0)
    return figure


def degradation_curves(
    curves: dict[str, dict[float, dict]], usual: dict[str, float], title: str
) -> Figure:
    """Draw autonomy and mean cross-track error over the values of each perturbation.

    Args:
        curves: figures of the drives by label of the panel, then by value; None leaves a gap.
        usual: value of an unperturbed drive by label, marked by a line.
        title: title of the figure.
    """
    columns = min(4, len(curves))
    rows = -(-len(curves) // columns)
    figure = NotebookFigure((max(4.5, 3.4 * columns), 2.7 * rows + 0.6), layout="constrained")
    axes = np.atleast_1d(figure.subplots(rows, columns, sharey=True)).ravel()
    worst = max(drive["cte_mean_m"] or 0 for drives in curves.values() for drive in drives.values())
    for axis in axes[len(curves) :]:
        axis.axis("off")
    for axis, (label, by_value) in zip(axes, curves.items(), strict=False):
        share = 100 * np.array([drive["autonomy"] for drive in by_value.values()], float)
        error = [drive["cte_mean_m"] for drive in by_value.values()]
        axis.axvline(usual[label], color=GREY, ls=":", lw=1)
        axis.plot(list(by_value), share, color=BLUE, marker="o", lw=2)
        axis.set(xlabel=label, ylim=(-4, 104))
        gap = "\nnot measured"
        axis.set_ylabel("autonomy (%)" + gap * bool(np.isnan(share).all()), color=BLUE)
        right = axis.twinx()
        right.plot(list(by_value), error, color=ORANGE, marker=".", lw=1.2)
        right.set_ylim(0, max(1.0, 1.1 * worst))
        right.set_ylabel("mean cross-track error (m)" + gap * (set(error) == {None}), color=ORANGE)
        for panel in (axis, right):
            panel.spines["top"].set_visible(False)
    figure.suptitle(plot_text(title))
    return figure

"""Draw `tracks.webp` and `roads.webp` in `docs/images`: `python docs/draw_tracks.py`.

The first shows plan and views of each track, the second the features of drawn roads: each family's
roads beside the originals' tracks, by the share of their length. It also prints each track's
length, tightest radius and grades, the figures of `docs/simulator.md`.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from zoo.simulator.centreline import STEP_M
from zoo.simulator.road_family import draw_road, family_names, find_family
from zoo.simulator.simulated_world import Start, open_world
from zoo.simulator.track import Track
from zoo.simulator.track_file import read_track
from zoo.simulator.track_names import track_names

IMAGES = Path(__file__).parent / "images"
ROAD = "#555555"
PLACES = (0.04, 0.3, 0.62)  # shares of the lap
ORIGINALS = ("udacity_lake", "udacity_jungle", "research_mountain")
ROADS = 200
COLOURS = ("#2a6fbb", "#d9822b", "#3a9a5b")
LEAST_CURVATURE = 1e-4  # 1/m; straights are drawn at it

FEATURES = {
    "|curvature|, 1/m": lambda road: np.maximum(np.abs(road.curvature), LEAST_CURVATURE),
    "|grade|, %": lambda road: 100 * np.abs(road.grade),
    "width, m": lambda road: road.widths,
    "length, m": lambda road: np.array([road.length]),
}


def draw_tracks(names: list[str]) -> plt.Figure:
    """Return a row for each track: its plan with the places of the views, and the views."""
    figure, rows = plt.subplots(
        len(names),
        1 + len(PLACES),
        figsize=(12, 2.0 * len(names)),
        width_ratios=[1.3, *[1.6] * len(PLACES)],
        squeeze=False,
        layout="constrained",
    )
    for name, (plan, *views) in zip(names, rows, strict=True):
        world = open_world(name)
        track = world.track
        plan.plot(*track.at(np.linspace(0, track.length, 1200))[:, :2].T, color=ROAD, lw=3)
        plan.set_aspect("equal")
        plan.axis("off")
        plan.set_title(f"{name}, {track.length:,.0f} m")
        for number, (share, view) in enumerate(zip(PLACES, views, strict=True), 1):
            start = Start(distance=share * track.length)
            world.reset(0, start)
            place = track.at(start.distance)[:2]
            plan.plot(*place, "o", color="#c0392b", ms=4)
            plan.annotate(str(number), place, xytext=(4, 3), textcoords="offset points")
            view.imshow(world.frame())
            view.set_title(f"{number}: at {start.distance:,.0f} m")
            view.axis("off")
    return figure


def figures(name: str) -> str:
    """Return a track's length, tightest radius, grades, range of heights and bridge in a line."""
    track = read_track(name)
    return (
        f"{name}: {track.length:,.0f} m, radius {1 / np.abs(track.curvature).max():.1f} m or more, "
        f"grades {track.grade.min():+.0%} to {track.grade.max():+.0%}, "
        f"{np.ptp(track.xyz[:, 2]):.1f} m high, {track.bridge.sum() * STEP_M:.0f} m of bridge"
    )


def draw_roads() -> plt.Figure:
    """Return a panel for each feature: the share of road (of roads, for the length) below a value.

    Solid lines have the families' roads, dashed lines the originals' tracks.
    """
    figure, axes = plt.subplots(2, 2, figsize=(10, 6.4), layout="constrained")
    groups: list[tuple[str, list[Track], str, str]] = [
        (name, [draw_road(find_family(name), seed) for seed in range(ROADS)], colour, "-")
        for name, colour in zip(family_names(), COLOURS, strict=False)
    ]
    groups += [
        (name, [read_track(name)], colour, "--")
        for name, colour in zip(ORIGINALS, ("#c0392b", "#8a5bb0", "#222222"), strict=True)
    ]
    for axis, (feature, measure) in zip(axes.flat, FEATURES.items(), strict=True):
        for name, roads, colour, style in groups:
            values = np.sort(np.concatenate([measure(road) for road in roads]))
            if values[0] == values[-1]:  # one width along the road, or one road
                axis.axvline(values[0], color=colour, ls=style, lw=1.4, label=name)
                continue
            shares = np.linspace(0, 100, len(values))
            axis.plot(values, shares, color=colour, ls=style, lw=1.6, label=name)
        axis.set(xlabel=feature, ylabel="below the value, %", ylim=(-2, 102))
        axis.spines[["top", "right"]].set_visible(False)
    axes.flat[0].set_xscale("log")
    axes.flat[0].legend(frameon=False, fontsize="small")
    figure.suptitle(f"{ROADS} roads of each family (solid) and the originals' tracks (dashed)")
    return figure


if __name__ == "__main__":
    print(*map(figures, track_names()), sep="\n")
    IMAGES.mkdir(exist_ok=True)
    settings = {"pil_kwargs": {"quality": 85}}
    draw_tracks(track_names()).savefig(IMAGES / "tracks.webp", dpi=110, **settings)
    draw_roads().savefig(IMAGES / "roads.webp", dpi=100, **settings)

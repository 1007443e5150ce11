"""Draw `docs/images/tracks.webp`, plan and views of each track: `python docs/draw_tracks.py`.

It also prints each track's length, tightest radius and grades, the figures of `docs/simulator.md`.
"""

from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("agg")
import matplotlib.pyplot as plt

from simulator.centreline import STEP_M
from simulator.track_file import read_track
from simulator.track_names import track_names
from simulator.world import Start, open_world

IMAGE = Path(__file__).parent / "images" / "tracks.webp"
ROAD = "#555555"
PLACES = (0.04, 0.3, 0.62)  # shares of the lap


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


if __name__ == "__main__":
    print(*map(figures, track_names()), sep="\n")
    IMAGE.parent.mkdir(exist_ok=True)
    draw_tracks(track_names()).savefig(IMAGE, dpi=110, pil_kwargs={"quality": 85})
    print(IMAGE)

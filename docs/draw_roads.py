"""Draw `docs/images/roads.webp`, the features of drawn roads: `python docs/draw_roads.py`.

Each family's roads stand beside the originals' tracks, by the share of their length.
"""

from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("agg")
import matplotlib.pyplot as plt

from simulator.road_family import draw_road, family_names, find_family
from simulator.track import Track
from simulator.track_file import read_track

IMAGE = Path(__file__).parent / "images" / "roads.webp"
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
    draw_roads().savefig(IMAGE, dpi=100, pil_kwargs={"quality": 85})
    print(IMAGE)

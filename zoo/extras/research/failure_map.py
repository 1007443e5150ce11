"""The map of a search: cells over two features, which failed, and their plot."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from zoo.base.file_text import plot_text
from zoo.extras.research.search_space import Feature
from zoo.runs.plots import BLUE

YELLOW = "#f2c500"
# No failure, then shares of failures from light to dark.
SHARES = ListedColormap(["#d6e4f0", "#fbe3cb", "#f6c38f", "#e79a4b", "#c96a17", "#8f4306"])
NORM = BoundaryNorm([0, 0.001, 0.2, 0.4, 0.6, 0.8, 1.001], SHARES.N)
Cell = tuple[int, int]
Style = dict[str, Any]  # of matplotlib


@dataclass
class Archive:
    """A grid of cells over two features, with the counts of drives and failures in each cell.

    Attributes:
        x, y: names of the features.
        scales: the two features' ranges, by their names.
        cells: number of cells along each feature; the outer cells have what lies beyond the range.
        driven, failed: number of drives and of failures in each cell that was driven.
    """

    x: str
    y: str
    scales: Mapping[str, Feature]
    cells: int
    driven: Counter[Cell] = field(default_factory=Counter)
    failed: Counter[Cell] = field(default_factory=Counter)

    def cell(self, features: Mapping[str, float]) -> Cell:
        """Return the cell that a road's features lie in."""
        column, row = (
            min(int(self.scales[name].scale.share(features[name]) * self.cells), self.cells - 1)
            for name in (self.x, self.y)
        )
        return column, row

    def edges(self, name: str) -> np.ndarray:
        """Return the borders between a feature's cells, float64 [cells + 1]."""
        scale = self.scales[name].scale
        return np.array([scale.at(number / self.cells) for number in range(self.cells + 1)])

    def add(self, features: Mapping[str, float], failed: bool) -> None:
        """Count a drive."""
        cell = self.cell(features)
        self.driven[cell] += 1
        if failed:
            self.failed[cell] += 1


def failure_map(
    archive: Archive,
    drives: Sequence[tuple[Mapping[str, float], bool]],
    mildest: Mapping[str, float] | None,
    title: str,
) -> Figure:
    """Draw the cells by their share of failures, each drive as a point, and the mildest failure.

    Args:
        archive: cells of the search.
        drives: features of each drive, and whether it failed.
        mildest: features of the mildest failing road; None without a failure.
        title: title of the plot.
    """
    figure = Figure(figsize=(7.6, 5.4), layout="constrained")
    axis = figure.subplots()
    edges = {name: archive.edges(name) for name in (archive.x, archive.y)}
    is_log = archive.scales[archive.x].scale.log
    shares = np.full((archive.cells, archive.cells), np.nan)
    for (column, row), driven in archive.driven.items():
        failed = archive.failed[column, row]
        shares[row, column] = failed / driven
        left, right = edges[archive.x][column : column + 2]
        low, high = edges[archive.y][row : row + 2]
        middle = np.sqrt(left * right) if is_log else (left + right) / 2
        ink = "white" if failed > driven / 2 else "black"
        text: Style = {"ha": "center", "va": "center", "fontsize": 7, "zorder": 4, "color": ink}
        axis.text(middle, high - 0.2 * (high - low), f"{failed}/{driven}", **text)
    mesh = axis.pcolormesh(edges[archive.x], edges[archive.y], shares, cmap=SHARES, norm=NORM)
    star: Style = {"s": 130, "color": YELLOW, "marker": "*", "ec": "black", "zorder": 5}
    passed: Style = {"s": 8, "color": BLUE, "marker": "o", "alpha": 0.8, "lw": 1.0, "zorder": 3}
    cross = passed | {"s": 26, "color": "black", "marker": "X", "ec": "white"}
    for label, roads, look in (
        ("driven without intervention", [road for road, failed in drives if not failed], passed),
        ("intervention", [road for road, failed in drives if failed], cross),
        ("mildest intervention", [mildest] if mildest else [], star),
    ):
        if roads or look is not star:
            across, up = ([road[name] for road in roads] for name in (archive.x, archive.y))
            axis.scatter(across, up, label=label, **look)
    for name, side, ticks in ((archive.x, "x", axis.xaxis), (archive.y, "y", axis.yaxis)):
        borders, scale = edges[name], archive.scales[name].scale
        values = [road[name] for road, _ in drives]
        limits = min([borders[0], *values]), max([borders[-1], *values])
        axis.set(**{f"{side}lim": limits, f"{side}label": archive.scales[name].label})
        if scale.log:
            axis.set(**{f"{side}scale": "log"})
        shown = borders[:: max(1, len(borders) // 6)]
        ticks.set_ticks(shown, [f"{border:.3g}" for border in shown])
        ticks.set_minor_locator(NullLocator())
    axis.set_title(plot_text(title), fontsize="medium")
    axis.spines[["top", "right"]].set_visible(False)
    label = "share of the cell's drives with an intervention"
    bar = figure.colorbar(mesh, ax=axis, shrink=0.6, label=label)
    bar.set_ticks(list(NORM.boundaries), labels=["0", ">0", "0.2", "0.4", "0.6", "0.8", "1"])
    figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize="small")
    return figure

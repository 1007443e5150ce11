"""A plot of figures with their 95 % intervals."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from zoo.runs.plots import BLUE, GREY, NotebookFigure


def interval_plot(figures: Mapping[str, Any], label: str, line: float | None = None) -> Figure:
    """Draw a row for each share: its value as a dot and its interval, both in percent.

    Args:
        figures: shares by the name of the row, from top to bottom.
        label: label of the axis.
        line: share to mark by a line; None for none.
    """
    rows = max(len(figures), 1)  # an axis needs a height without figures, too
    figure = NotebookFigure(figsize=(6, 0.9 + 0.35 * rows), layout="constrained")
    axis = figure.subplots()
    if line is not None:
        axis.axvline(100 * line, color=GREY, ls=":", lw=1)
    for row, share in enumerate(figures.values()):
        # NaN, also of None, is not drawn.
        low, value, high = 100 * np.array([share.low, share.value, share.high], float)
        axis.plot([low, high], [row, row], color=BLUE, lw=1.5)
        axis.plot(value, row, "o", color=BLUE)
    axis.set_yticks(range(len(figures)), list(figures))
    axis.set(xlabel=f"{label}; bar: 95 % interval", ylim=(rows - 0.5, -0.5))
    axis.grid(axis="x", alpha=0.2)
    axis.spines[["top", "right"]].set_visible(False)
    return figure

"""Curves of shares with intervals, in panels side by side: the plots of a paper."""

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from zoo.base.file_text import plot_text
from zoo.runs.plots import NotebookFigure, plain_axis


def share_panels(
    panels: Mapping[str, tuple[Sequence[float], Mapping[str, Sequence[Any]]]],
    label: str,
    shares: str,
) -> Figure:
    """Draw curves of shares with bands, or bars at few places, in panels side by side.

    Args:
        panels: by title, the places on the horizontal axis, and the curves by name; each has a
            share for every place, with `value`, `low` and `high`, 0..1.
        label: label of that axis.
        shares: label of the shares' axis.
    """
    few = all(len(places) < 10 for places, _ in panels.values())
    longest = max(len(plot_text(name)) for _, curves in panels.values() for name in curves)
    width = min(max(longest, 20), 400) / 13 + (5.5 if len(panels) == 1 else 0.5 + 2.4 * len(panels))
    figure = NotebookFigure(figsize=(width, 3.4), layout="constrained")
    axes = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
    for axis, (title, (places, curves)) in zip(axes, panels.items(), strict=True):
        styles = itertools.cycle(("-", "--", "-.", ":"))
        for number, (name, points) in enumerate(curves.items()):
            low, value, high = 100 * np.array([(p.low, p.value, p.high) for p in points], float).T
            # Side by side, since bars of several curves at one place hide each other.
            beside = np.array(places) + (0.6 * (number + 0.5) / len(curves) - 0.3 if few else 0)
            style = ("." if few else "") + next(styles)
            (curve,) = axis.plot(beside, value, style, label=plot_text(name))
            if few:
                axis.vlines(beside, low, high, color=curve.get_color(), lw=1, alpha=0.6)
            else:
                axis.fill_between(beside, low, high, color=curve.get_color(), alpha=0.15, lw=0)
        axis.set(title=plot_text(title), ylim=(-2 if few else 0, 102), xlabel=label)
        axis.margins(x=0.05 if few else 0)
        plain_axis(axis)
    axes[0].set_ylabel(f"{shares}; {'bar' if few else 'band'}: 95 % interval")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside right upper", frameon=False)
    return figure

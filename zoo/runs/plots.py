"""Plots of data and training as matplotlib figures, drawn without a window."""

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from datamodules.view import view_to_rgb
from zoo.base.file_text import plot_text
from zoo.base.whole_file import write_whole

BLUE, ORANGE, GREY = "#2a6fbb", "#d9822b", "#8a8a8a"
LEAST_CAPPED = 0.02  # share of nearly straight samples that balancing takes away, if it does


class NotebookFigure(Figure):
    """A figure that is an image as the last value of a notebook's cell, also without pyplot."""

    def _repr_png_(self) -> bytes:
        """Return the figure as PNG, which notebooks look for."""
        file = io.BytesIO()
        self.savefig(file, format="png")
        return file.getvalue()


def steering_histogram(before: np.ndarray, after: np.ndarray, threshold: float) -> Figure:
    """Plot the shares of the steering before and after balancing, side by side on one scale.

    Where balancing changes nothing, the title says so.

    Args:
        before: steering of all training samples, float [N].
        after: steering of one epoch's samples, float [M].
        threshold: largest |steering| that counts as nearly straight; titles name the share.
    """
    figure = Figure(figsize=(9, 3.8))  # fixed margins: layout="constrained" takes 0.1 s longer
    figure.subplots_adjust(left=0.1, right=0.975, bottom=0.14, top=0.86, wspace=0.28)
    axes = figure.subplots(1, 2, sharex=True, sharey=True)
    shares = [float(np.mean(np.abs(steering) < threshold)) for steering in (before, after)]
    is_capped = shares[1] < shares[0] - LEAST_CAPPED
    balanced = "One balanced epoch" if is_capped else "One epoch: straight_cap changes nothing"
    titles = ("All training samples", balanced)
    for axis, steering, title, straight, colour in zip(
        axes, (before, after), titles, shares, (GREY, BLUE), strict=True
    ):
        counts, edges = np.histogram(steering, np.linspace(-1, 1, 41))
        axis.stairs(100 * counts / max(len(steering), 1), edges, fill=True, color=colour)
        axis.axvspan(-threshold, threshold, color=ORANGE, alpha=0.15, lw=0)
        axis.set_title(f"{title}\n{len(steering):,}, {straight:.0%} within ±{threshold:g}")
        axis.set(xlabel="steering (negative: left)", ylabel="samples (%)")
        axis.set_xticks([-1, -0.5, 0, 0.5, 1])
        plain_axis(axis)
    return figure


def predicted_against_true(predicted: np.ndarray, true: np.ndarray, title: str) -> Figure:
    """Plot a point for each row and the line of equality.

    Args:
        predicted: the network's steering, float [N] in -1..1.
        true: recorded steering, float [N] in -1..1.
        title: title of the plot.
    """
    figure = Figure(figsize=(4.8, 4.8), layout="constrained")
    axis = figure.subplots()
    limit = max(0.1, float(np.abs(np.concatenate([predicted, true])).max())) * 1.05
    axis.plot([-limit, limit], [-limit, limit], color=ORANGE, lw=1.5, label="predicted = recorded")
    axis.scatter(true, predicted, s=9, alpha=0.4, color=BLUE, lw=0)
    axis.set(xlim=(-limit, limit), ylim=(-limit, limit), aspect="equal")
    axis.locator_params(nbins=5)
    axis.set(xlabel="recorded steering", ylabel="predicted steering", title=title)
    figure.legend(frameon=False, loc="outside lower center")  # on no point
    plain_axis(axis)
    return figure


def training_curves(train: dict[int, float], val: dict[int, float], baseline: float) -> Figure:
    """Plot the training loss and the validation MSE by epoch, with a baseline.

    Args:
        train: training loss by epoch; 1 is the first epoch.
        val: validation MSE by epoch.
        baseline: validation MSE of a prediction that is always 0.
    """
    figure = Figure(figsize=(7, 4), layout="constrained")
    axis = figure.subplots()
    axis.plot(list(train), list(train.values()), color=GREY, marker=".", label="training loss")
    if val:
        axis.plot(list(val), list(val.values()), color=BLUE, marker=".", label="validation MSE")
        axis.axhline(baseline, color=ORANGE, ls="--", lw=1.2, label="validation MSE of always zero")
    is_error = min(train.values(), default=1.0) > 0  # a likelihood can be negative
    scale, label = ("log", "mean squared error (log scale)") if is_error else ("linear", "loss")
    axis.set(yscale=scale, xlabel="epoch", ylabel=label, title="Training curves")
    axis.locator_params("x", integer=True)
    axis.legend(frameon=False)
    plain_axis(axis)
    return figure


def fed_batch(images: np.ndarray, steering: np.ndarray, colour: str, title: str) -> Figure:
    """Plot a grid of the network's input images, each with its label.

    Args:
        images: images after the view and augmentation, uint8 [N, H, W, C]; or windows, each a row
            of the grid, [N, sequence, H, W, C].
        steering: labels, float [N] or [N, sequence] in -1..1.
        colour: the view's colour, such as `rgb`.
        title: title of the plot.
    """
    in_row = images.shape[1] if images.ndim == 5 else None
    images = images.reshape(-1, *images.shape[-3:])
    count, height, width = images.shape[:3]
    columns = in_row or max(1, min(count, round(np.sqrt(count * 1.4 * height / width))))
    rows = -(-count // columns)
    # One image for the whole grid: an axis for each would take two seconds at every start.
    gap = max(1, round(0.06 * width)), max(2, round(0.28 * columns * width / 13))
    step_x, step_y = width + gap[0], height + gap[1]
    sheet = np.full((rows * step_y, columns * step_x - gap[0], 3), 255, np.uint8)
    aspect = sheet.shape[0] / sheet.shape[1]
    figure = Figure(figsize=(13.0, 13.0 * aspect + 0.5))
    figure.suptitle(title)
    axis = figure.add_axes((0.01, 0.0, 0.98, 13.0 * aspect / (13.0 * aspect + 0.5)))
    axis.axis("off")
    for index, (image, label) in enumerate(zip(images, steering.ravel(), strict=True)):
        left, top = index % columns * step_x, index // columns * step_y + gap[1]
        sheet[top : top + height, left : left + width] = view_to_rgb(image, colour)
        # A line from the bottom centre in the label's direction; full lock is 45 degrees.
        length, angle = 0.5 * height, label * np.pi / 4
        bottom, middle = top + height - 1, left + width / 2
        tip = middle + length * np.sin(angle), bottom - length * np.cos(angle)
        axis.plot([middle, tip[0]], [bottom, tip[1]], color=ORANGE, lw=2)
        text = f"{round(label, 3) + 0.0:+.3f}"
        axis.text(middle, top - 0.15 * gap[1], text, fontsize=9, ha="center", va="bottom")
    axis.imshow(sheet, interpolation="nearest", aspect="equal")
    return figure


def interval_plot(
    figures: Mapping[str, Any], label: str, line: float | None = None, factor: float = 100
) -> Figure:
    """Draw a row for each figure: its value as a dot and its interval, by default in percent.

    Args:
        figures: figures by the name of the row, from top to bottom.
        label: label of the axis.
        line: figure to mark by a line; None for none.
        factor: what the figures are multiplied by.
    """
    figure = interval_panels({f"{label}; bar: 95 % interval": (figures, factor)})
    if line is not None:
        figure.axes[0].axvline(factor * line, color=GREY, ls=":", lw=1, zorder=0)
    return figure


def interval_panels(panels: Mapping[str, tuple[Mapping[str, Any], float]]) -> Figure:
    """Draw intervals as in `interval_plot`, in panels side by side that share their rows.

    Args:
        panels: by label of the axis, the figures by the name of the row, and their factor.
    """
    rows = max(1, *(len(figures) for figures, _ in panels.values()))  # an axis needs a height
    longest = max((len(name) for figures, _ in panels.values() for name in figures), default=0)
    # Else long names would take their width from the axes.
    width = min(max(longest, 20), 400) / 13 + (4.5 if len(panels) == 1 else 2.4 * len(panels))
    figure = NotebookFigure(figsize=(width, 0.9 + 0.35 * rows), layout="constrained")
    axes = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
    for axis, (label, (figures, factor)) in zip(axes, panels.items(), strict=True):
        for row, point in enumerate(figures.values()):
            # NaN, also of None, is not drawn.
            low, value, high = factor * np.array([point.low, point.value, point.high], float)
            axis.plot([low, high], [row, row], color=BLUE, lw=1.5)
            axis.plot(value, row, "o", color=BLUE)
        axis.set_yticks(range(len(figures)), map(plot_text, figures))
        axis.set(xlabel=label, ylim=(rows - 0.5, -0.5))
        plain_axis(axis, "x")
    return figure


def save_figure(figure: Figure, path: Path) -> Path:
    """Write a figure as PNG, create its folder, and return its path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    contents = io.BytesIO()
    # At zlib's usual level 6, a plot with images takes 0.1 s longer and is 7 % smaller.
    figure.savefig(contents, dpi=110, format="png", pil_kwargs={"compress_level": 1})
    return write_whole(path, contents.getbuffer())


def plain_axis(axis: Axes, grid: Literal["both", "x"] = "both") -> None:
    """Remove the upper and right line of an axis, and draw a faint grid."""
    axis.spines[["top", "right"]].set_visible(False)
    axis.grid(axis=grid, alpha=0.2)

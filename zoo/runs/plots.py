"""Pictures of data and training, as matplotlib figures; nothing here opens a window."""

import io
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from datamodules.view import view_to_rgb
from zoo.runs.whole_file import write_whole

BLUE, ORANGE, GREY = "#2a6fbb", "#d9822b", "#8a8a8a"


def steering_histogram(before: np.ndarray, after: np.ndarray, threshold: float) -> Figure:
    """Steering of all samples, and of those an epoch is fed (both float [N]), side by side.

    `threshold` is where nearly straight ends; its share is written into each title.
    """
    figure = Figure(figsize=(9, 3.6), layout="constrained")
    axes = figure.subplots(1, 2, sharex=True)
    titles = ("all training samples", "one epoch as fed")
    for axis, steering, title, colour in zip(
        axes, (before, after), titles, (GREY, BLUE), strict=True
    ):
        axis.hist(steering, bins=np.linspace(-1, 1, 41), color=colour)
        straight = np.mean(np.abs(steering) < threshold)
        axis.axvspan(-threshold, threshold, color=ORANGE, alpha=0.15, lw=0)
        axis.set_title(f"{title}: {len(steering):,}, {straight:.0%} within ±{threshold:g}")
        axis.set_xlabel("steering (left is negative)")
        axis.set_ylabel("samples")
        axis.set_xticks([-1, -0.5, 0, 0.5, 1])
        _plain(axis)
    return figure


def predicted_against_true(predicted: np.ndarray, true: np.ndarray, title: str) -> Figure:
    """A point a row, with the line of equality; both float [N] in -1..1."""
    figure = Figure(figsize=(4.8, 4.8), layout="constrained")
    axis = figure.subplots()
    limit = max(0.1, float(np.abs(np.concatenate([predicted, true])).max())) * 1.05
    axis.plot([-limit, limit], [-limit, limit], color=ORANGE, lw=1.5, label="equal")
    axis.scatter(true, predicted, s=9, alpha=0.4, color=BLUE, lw=0)
    axis.set(xlim=(-limit, limit), ylim=(-limit, limit), aspect="equal")
    axis.locator_params(nbins=5)
    axis.set_xlabel("recorded steering")
    axis.set_ylabel("predicted steering")
    axis.set_title(title)
    axis.legend(frameon=False, loc="upper left")
    _plain(axis)
    return figure


def training_curves(train: dict[int, float], val: dict[int, float], baseline: float) -> Figure:
    """Loss and validation MSE by epoch (1 is the first), beside the MSE of always zero."""
    figure = Figure(figsize=(7, 4), layout="constrained")
    axis = figure.subplots()
    axis.plot(list(train), list(train.values()), color=GREY, marker=".", label="training loss")
    if val:
        axis.plot(list(val), list(val.values()), color=BLUE, marker=".", label="validation MSE")
        axis.axhline(baseline, color=ORANGE, ls="--", lw=1.2, label="always zero, validation")
    axis.set_yscale("log")
    axis.set_xlabel("epoch")
    axis.locator_params("x", integer=True)
    axis.set_ylabel("mean squared error (log scale)")
    axis.set_title("training curves")
    axis.legend(frameon=False)
    _plain(axis)
    return figure


def fed_batch(pictures: np.ndarray, steering: np.ndarray, colour: str, title: str) -> Figure:
    """A grid of what the network is fed, uint8 [N, H, W, C], the label on each."""
    count = len(pictures)
    height, width = pictures.shape[1:3]
    columns = max(1, min(count, round(np.sqrt(count * 1.4 * height / width))))
    rows = -(-count // columns)
    # One picture of all: as many axes would take two seconds at every start.
    gap = max(1, round(0.06 * width)), max(2, round(0.28 * columns * width / 13))
    step_x, step_y = width + gap[0], height + gap[1]
    sheet = np.full((rows * step_y, columns * step_x - gap[0], 3), 255, np.uint8)
    aspect = sheet.shape[0] / sheet.shape[1]
    figure = Figure(figsize=(13.0, 13.0 * aspect + 0.5))
    figure.suptitle(title)
    axis = figure.add_axes((0.01, 0.0, 0.98, 13.0 * aspect / (13.0 * aspect + 0.5)))
    axis.axis("off")
    for index, (picture, label) in enumerate(zip(pictures, steering, strict=True)):
        left, top = index % columns * step_x, index // columns * step_y + gap[1]
        sheet[top : top + height, left : left + width] = view_to_rgb(picture, colour)
        # From the bottom centre to where the label points, full lock at 45 degrees.
        length, angle = 0.5 * height, label * np.pi / 4
        bottom, middle = top + height - 1, left + width / 2
        tip = middle + length * np.sin(angle), bottom - length * np.cos(angle)
        axis.plot([middle, tip[0]], [bottom, tip[1]], color=ORANGE, lw=2)
        text = f"{label + 0.0:+.3f}"
        axis.text(middle, top - 0.15 * gap[1], text, fontsize=9, ha="center", va="bottom")
    axis.imshow(sheet, interpolation="nearest", aspect="equal")
    return figure


def save_figure(figure: Figure, path: Path) -> Path:
    """Write a PNG, making its folder."""
    path.parent.mkdir(parents=True, exist_ok=True)
    contents = io.BytesIO()
    figure.savefig(contents, dpi=110, format="png")
    return write_whole(path, contents.getbuffer())


def _plain(axis: Axes) -> None:
    axis.spines[["top", "right"]].set_visible(False)
    axis.grid(alpha=0.2)

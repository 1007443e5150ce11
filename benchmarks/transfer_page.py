"""The figure and the table of `benchmarks/transfer.py`, from `docs/transfer.csv`."""

import csv
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.claims_page import mean_with_interval
from benchmarks.marked_page import markdown_table, write_between
from zoo.runs.plots import BLUE, GREY, ORANGE, save_figure

CSV, PAGE = Path("docs/transfer.csv"), Path("docs/models/efficientnet_lite0.md")
PLOT = Path("docs/transfer.png")
BEGIN, END = "<!-- transfer -->", "<!-- end of transfer -->"
SHARES = (0.1, 0.3, 1.0)
SETTINGS = ("scratch", "frozen random", "frozen ImageNet", "fine-tuned ImageNet")
COLOURS = dict(zip(SETTINGS, ("black", GREY, ORANGE, BLUE), strict=True))
TRACKS = ("udacity_lake", "udacity_jungle")  # of the recording, and never seen
GROUP = ("samples", "size")  # trainings that differ in these are not compared


def read_csv() -> list[dict]:
    """Return the lines of `docs/transfer.csv`, all as text."""
    with CSV.open(newline="") as file:
        return list(csv.DictReader(file))


def write_page(rows: list[dict]) -> list[Path]:
    """Write the table between the page's markers, and the figure; return the files.

    Trainings of different lengths are not mixed: only those with the most samples are shown.
    """
    shown = largest_group(rows)
    save_figure(plot(shown), PLOT)
    image = f"![what ImageNet weights help](../{PLOT.name})"
    write_between(PAGE, BEGIN, END, f"{made(shown)}\n\n{image}\n\n{table(shown)}")
    return [PAGE, PLOT]


def largest_group(rows: list[dict]) -> list[dict]:
    """Return the trainings of the group with the most samples, then the most trainings."""
    groups: dict[tuple[str, ...], list[dict]] = {}
    for row in rows:
        groups.setdefault(tuple(row[name] for name in GROUP), []).append(row)
    return max(groups.values(), key=lambda group: (int(group[0]["samples"]), len(group)))


def made(rows: list[dict]) -> str:
    """Return what was run, and which trainings and drives are missing."""
    first = rows[0]
    seeds = max(int(row["seed"]) for row in rows)
    laps = sorted({float(row["laps"]) for row in rows if row["laps"]})
    planned = [
        (setting, share, seed)
        for seed in range(1, seeds + 1)
        for share in SHARES
        for setting in SETTINGS
    ]
    done = {(row["setting"], float(row["share"]), int(row["seed"])) for row in rows}
    untrained = [one for one in planned if one not in done]
    undriven = sum(row[f"{track}_autonomy"] == "" for row in rows for track in TRACKS)
    text = (
        f"{len(rows)} trainings of {int(first['samples']):,} samples each, view "
        f"{first['size'].replace('x', ' x ')}, {count_of(seeds, 'training seed')}."
    )
    if laps:
        text += f" Each drive has {' or '.join(f'{one:g}' for one in laps)} laps."
    if untrained:
        names = (f"{name}, {100 * share:.0f} %, seed {seed}" for name, share, seed in untrained)
        text += f" Not trained: {'; '.join(names)}."
    if undriven:
        text += f" Not driven: {undriven} of {len(rows) * len(TRACKS)} drives."
    return text


def count_of(count: int, noun: str) -> str:
    """Return a count with its noun.

    >>> count_of(1, "seed"), count_of(2, "seed")
    ('1 seed', '2 seeds')
    """
    return f"{count} {noun}{'s' * (count != 1)}"


def table(rows: list[dict]) -> str:
    """Return a line for each setting and share: validation error and autonomy."""
    head = ["weights", "training rows", "seeds", "validation error"]
    head += [f"`{track}`: autonomy" for track in TRACKS]
    lines = []
    for setting in SETTINGS:
        for share in SHARES:
            runs = of(rows, setting, share)
            if runs:
                lines.append(
                    [
                        setting,
                        f"{100 * share:.0f} % ({int(runs[0]['train_rows']):,})",
                        str(len(runs)),
                        f"{np.mean(relative_errors(runs)):.2f}",
                        *(_autonomy(runs, track) for track in TRACKS),
                    ]
                )
    return markdown_table(head, lines, left=2)


def of(rows: list[dict], setting: str, share: float) -> list[dict]:
    """Return the trainings of a setting and a share."""
    return [row for row in rows if row["setting"] == setting and float(row["share"]) == share]


def relative_errors(runs: list[dict]) -> list[float]:
    """Return each training's balanced validation error, over that of always steering 0."""
    return [float(one["val_balanced_mae"]) / float(one["val_zero_balanced_mae"]) for one in runs]


def autonomies(runs: list[dict], track: str) -> list[float]:
    """Return the autonomy of the trainings that drove a track, percent."""
    driven = [run[f"{track}_autonomy"] for run in runs]
    return [100 * float(one) for one in driven if one != ""]


def _autonomy(runs: list[dict], track: str) -> str:
    driven = autonomies(runs, track)
    return mean_with_interval(driven) if driven else "-"


def plot(rows: list[dict]) -> Figure:
    """Plot validation error and autonomy by share of the recording, a line for each setting."""
    figure = Figure(figsize=(12, 3.8), layout="constrained")
    axes = figure.subplots(1, 3)
    _lines(axes[0], rows, relative_errors)
    axes[0].set(title="validation error (always 0: 1)", ylim=(0, None))
    for axis, track, seen in zip(axes[1:], TRACKS, ("recorded", "never seen"), strict=True):
        _lines(axis, rows, lambda runs, track=track: autonomies(runs, track))
        axis.set(title=f"autonomy, %: {track} ({seen})", ylim=(-3, 103))
    axes[0].legend(frameon=False, fontsize=8)
    seeds = count_of(len({row["seed"] for row in rows}), "training seed")
    figure.suptitle(
        f"EfficientNet-Lite0, {int(rows[0]['samples']):,} samples each, {seeds}", fontsize=10
    )
    return figure


def _lines(axis: Axes, rows: list[dict], values: object) -> None:
    for setting in SETTINGS:
        found = [(share, values(of(rows, setting, share))) for share in SHARES]
        found = [(100 * share, one) for share, one in found if one]
        shares = [share for share, _ in found]
        colour = COLOURS[setting]
        axis.plot(shares, [np.mean(one) for _, one in found], color=colour, label=setting)
        for share, one in found:
            axis.plot([share] * len(one), one, "o", color=colour, ms=4)
    axis.set_xscale("log")
    axis.set_xticks([100 * share for share in SHARES], [f"{100 * s:.0f}" for s in SHARES])
    axis.minorticks_off()
    axis.set_xlim(100 * SHARES[0] / 1.2, 120)
    axis.set_xlabel("share of the training rows, %")
    axis.spines[["top", "right"]].set_visible(False)

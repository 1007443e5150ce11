"""Correlate open-loop metrics with driving: `python benchmarks/offline_metrics.py`.

It reads `docs/results.csv` (from `python benchmarks/results.py`) and computes Spearman's rank
correlation between each metric and each driving figure over all networks, with a 95 % interval by
resampling the networks. Metrics are of a network's own test rows, for each split, and of one
recording of recoveries, the same for all networks (`benchmarks/recoveries.py`). The script writes
`docs/offline_metrics.md` and `docs/offline_metrics.png`.
"""

import csv
import sys

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter
from scipy.stats import spearmanr

from benchmarks.marked_page import write_between
from benchmarks.results import CSV
from zoo.base.errors import InputError
from zoo.cli.run_command import run_command
from zoo.runs.plots import save_figure

METRICS = {
    "test_mse": "MSE",
    "test_mae": "MAE",
    "test_balanced_mae": "balanced MAE",
    "test_bias": "absolute bias",
}
# Metrics on the recording of recoveries, and the sign with which a larger value is worse.
RECOVERIES = {
    "recoveries_mse": ("MSE", 1),
    "recoveries_mae": ("MAE", 1),
    "recoveries_balanced_mae": ("balanced MAE", 1),
    "recoveries_side_mae": ("MAE of the side cameras", 1),
    "recoveries_side_response": ("response to the side cameras", -1),
}
# Figures of driving, and the sign with which a larger value is worse.
DRIVEN = {
    "lake_cte_mean_m": ("lake, mean error", 1),
    "lake_interventions": ("lake, interventions", 1),
    "mountain_autonomy": ("mountain, autonomy", -1),
}
TEST_PLOTTED = ("test_mse", "test_balanced_mae")
RECOVERIES_PLOTTED = ("recoveries_mse", "recoveries_side_response")
DRIVEN_PLOTTED = ("lake_cte_mean_m", "mountain_autonomy")
COLOURS = {"lenet": "#2a6fbb", "nvidia": "#d9822b", "tiny": "#3a9a5b", "tiny63": "#8a5bb0"} | {
    "commaai": "#c0392b",
    "linear": "#222222",
}
OTHER = "#8a8a8a"
RESAMPLINGS = 2_000
FEWEST = 8


def read_rows() -> list[dict]:
    """Return the runs with drives, figures as floats.

    Raises:
        InputError: the file is missing.
    """
    if not CSV.is_file():
        raise InputError(f"{CSV}: not found; run python benchmarks/results.py first")
    with CSV.open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["lake_autonomy"]]
    for row in rows:
        for key in (*METRICS, *RECOVERIES, *DRIVEN):
            row[key] = abs(float(row[key])) if key == "test_bias" else float(row[key])
    # If the first epoch was the best, a longer training has the same network and counts once.
    return list({tuple(row[key] for key in METRICS): row for row in rows}.values())


def rank_correlation(offline: np.ndarray, driven: np.ndarray) -> tuple[float, float, float]:
    """Return Spearman's correlation and its 95 % interval; NaN if all drives are equal."""
    rng = np.random.default_rng(0)
    found = []
    for _ in range(RESAMPLINGS):
        chosen = rng.integers(0, len(offline), len(offline))
        if len(set(offline[chosen])) > 1 and len(set(driven[chosen])) > 1:
            found.append(spearmanr(offline[chosen], driven[chosen]).statistic)
    if len(set(driven)) < 2:
        return float("nan"), float("nan"), float("nan")
    low, high = np.quantile(found, [0.025, 0.975])
    return float(spearmanr(offline, driven).statistic), float(low), float(high)


def by_split(rows: list[dict]) -> dict[str, list[dict]]:
    """Return the rows of each split with at least `FEWEST` networks."""
    names = dict.fromkeys(row["split"] for row in rows)
    found = {name: [row for row in rows if row["split"] == name] for name in names}
    return {name: own for name, own in found.items() if len(own) >= FEWEST}


def correlation_table(splits: dict[str, list[dict]]) -> str:
    """Return a Markdown table with a line for each metric of test rows and split."""
    labels = " | ".join(label for label, _ in DRIVEN.values())
    lines = [
        f"| metric on the test rows | split | networks | {labels} |",
        "|---|---|---:|" + "---:|" * len(DRIVEN),
    ]
    for metric, label in METRICS.items():
        for split, rows in splits.items():
            lines.append(f"| {label} | {split} | {len(rows)} | {_cells(rows, metric)} |")
    return "\n".join(lines)


def recoveries_table(rows: list[dict]) -> str:
    """Return a Markdown table with a line for each metric of recoveries, over all networks."""
    labels = " | ".join(label for label, _ in DRIVEN.values())
    lines = [
        f"| metric on the recoveries | networks | {labels} |",
        "|---|---:|" + "---:|" * len(DRIVEN),
    ]
    for metric, (label, sign) in RECOVERIES.items():
        lines.append(f"| {label} | {len(rows)} | {_cells(rows, metric, sign)} |")
    return "\n".join(lines)


def _cells(rows: list[dict], metric: str, sign: int = 1) -> str:
    cells = []
    offline = sign * np.array([row[metric] for row in rows])
    for key, (_, worse) in DRIVEN.items():
        value, low, high = rank_correlation(offline, worse * np.array([row[key] for row in rows]))
        cells.append(f"{value:+.2f} ({low:+.2f} to {high:+.2f})")
    return " | ".join(cells)


def scatter(splits: dict[str, list[dict]], rows: list[dict]) -> Figure:
    """Plot metrics against driving: a line of plots for each split, and one for recoveries.

    Each line has two metrics against the mean error on the lake and the autonomy on the mountain.
    """
    panels = [
        (f"test rows, split {split}", own, {key: (METRICS[key], 1) for key in TEST_PLOTTED})
        for split, own in splits.items()
    ]
    panels.append(("recoveries", rows, {key: RECOVERIES[key] for key in RECOVERIES_PLOTTED}))
    figure = Figure(figsize=(15, 3.6 * len(panels)), layout="constrained")
    axes = np.atleast_2d(figure.subplots(len(panels), 2 * len(TEST_PLOTTED)))
    for line, (where, own, metrics) in zip(axes, panels, strict=True):
        pairs = [(key, driven) for driven in DRIVEN_PLOTTED for key in metrics]
        for axis, (key, driven) in zip(line, pairs, strict=True):
            label, sign = metrics[key]
            _plot(axis, own, key, driven)
            value, *_ = rank_correlation(
                sign * np.array([row[key] for row in own]),
                DRIVEN[driven][1] * np.array([row[driven] for row in own]),
            )
            axis.set(
                xscale="log" if sign > 0 else "linear",  # a response may be negative
                xlabel=f"{label}, {where}",
                ylabel=DRIVEN[driven][0] + (" (m)" if driven.endswith("_m") else ""),
                title=f"rank correlation {value:+.2f}",
            )
            if sign > 0:
                axis.xaxis.set_minor_formatter(NullFormatter())
    marks = {}
    for axis in axes.flat:
        marks |= dict(zip(*reversed(axis.get_legend_handles_labels()), strict=True))
    figure.legend(marks.values(), marks.keys(), loc="outside upper center", ncols=len(marks))
    return figure


def _plot(axis: Axes, rows: list[dict], key: str, driven: str) -> None:
    for model in dict.fromkeys(row["model"] for row in rows):
        own = [row for row in rows if row["model"] == model]
        axis.scatter(
            [row[key] for row in own],
            [row[driven] for row in own],
            color=COLOURS.get(model, OTHER),
            label=model,
            s=28,
            alpha=0.8,
            lw=0,
        )
    axis.spines[["top", "right"]].set_visible(False)
    axis.grid(alpha=0.2)


def main(arguments: list[str]) -> None:
    """Write the table and the plot.

    Raises:
        InputError: there are no results, or too few networks.
    """
    if arguments:
        raise InputError("takes no arguments")
    rows = read_rows()
    splits = by_split(rows)
    if not splits:
        raise InputError(
            f"{CSV}: fewer than {FEWEST} driven networks of each split; run more recipes"
        )
    plot = save_figure(scatter(splits, rows), CSV.parent / "offline_metrics.png")
    page = CSV.parent / "offline_metrics.md"
    tables = {"test rows": correlation_table(splits), "recoveries": recoveries_table(rows)}
    for name, table in tables.items():
        write_between(page, f"<!-- {name} -->", f"<!-- end of {name} -->", table)
    print("\n\n".join([*tables.values(), f"{plot}\n{page}"]))


if __name__ == "__main__":
    sys.exit(run_command("offline_metrics", main, sys.argv[1:]))

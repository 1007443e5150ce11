"""The tables and the plot of `docs/claims.md`, from `docs/claims.csv`."""

import math
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from benchmarks.marked_page import markdown_table, write_between
from zoo.drives.bootstrap import mean_over_seeds
from zoo.drives.intervals import count_with_interval
from zoo.runs.plots import BLUE, GREY, ORANGE, save_figure

CSV, PAGE = Path("docs/claims.csv"), Path("docs/claims.md")
PLOT = Path("docs/claims_frame_rate.png")
BEGIN, END = "<!-- claims -->", "<!-- end of claims -->"
PLOT_BEGIN, PLOT_END = "<!-- frame rate -->", "<!-- end of frame rate -->"
DATA = {"expert": "expert, `udacity_lake`", "real": "real recording"}
COLOURS = {"expert": BLUE, "real": ORANGE}
USUAL_RATE = 15.0  # Hz
CONTROL = "throttle 0.2"  # of the plot
# What the write-ups say of a track; nothing is claimed of the others.
CLAIMS = {
    ("A", "udacity_lake"): "drives, a little rough in the first sharp turn",
    ("A", "udacity_jungle"): "drives without a fault, not trained on it",
    ("B", "udacity_lake"): "drives a lap",
    ("C", "udacity_lake", "throttle 0.2"): "drives",
    ("C", "udacity_jungle", "throttle 0.3"): "drives, not trained on it",
}


def write_page(rows: list[dict]) -> list[Path]:
    """Write the tables between the page's markers and the plot; return the files.

    Args:
        rows: lines of `docs/claims.csv`, as text.
    """
    usual = [row for row in rows if float(row["frame_rate"]) == USUAL_RATE]
    write_between(PAGE, BEGIN, END, claims_table(usual))
    curve = [row for row in rows if row["recipe"] == "C" and row["control"] == CONTROL]
    curve = [row for row in curve if row["track"] == "udacity_lake"]
    if len({row["frame_rate"] for row in curve}) < 2:
        write_between(PAGE, PLOT_BEGIN, PLOT_END, "Not measured yet.")
        return [PAGE]
    save_figure(frame_rate_plot(curve), PLOT)
    write_between(PAGE, PLOT_BEGIN, PLOT_END, f"![autonomy by frame rate]({PLOT.name})")
    return [PAGE, PLOT]


def claims_table(rows: list[dict]) -> str:
    """Return a line for each recipe, training data, track and control: claimed against measured."""
    head = ["recipe", "trained on", "training", "track", "control", "claimed", "seeds"]
    head += ["autonomy (95 %)", "without intervention", "mean error, m", "largest error, m"]
    groups: dict[tuple[str, ...], list[dict]] = {}
    names = ("recipe", "experiment", "data", "training", "weights", "track", "control")
    for row in rows:
        groups.setdefault(tuple(row[name] for name in names), []).append(row)
    lines = []
    for (recipe, experiment, data, training, weights, track, control), runs in groups.items():
        claim = CLAIMS.get((recipe, track, control)) or CLAIMS.get((recipe, track), "-")
        name = f"{recipe}: `{experiment}`" + (f", {weights}" if weights else "")
        setting = [name, DATA[data], training, f"`{track}`", control, claim]
        lines.append([*setting, str(len(runs)), *_measured(runs)])
    return markdown_table(head, lines, left=6)


def _measured(runs: list[dict]) -> list[str]:
    stalls = [float(run["stalled_m"]) for run in runs if run["stalled_m"]]
    clean = sum(run["interventions"] != "" and not float(run["interventions"]) for run in runs)
    count = count_with_interval(clean, len(runs))
    driven = [100 * float(run["autonomy"]) for run in runs if run["autonomy"]]
    if stalls:
        places = list(dict.fromkeys(f"{ends(stalls):.0f}" for ends in (min, max)))
        text = f"{len(stalls)} of {len(runs)} stall, at {' to '.join(places)} m"
        text += f"; the others {np.mean(driven):.1f} %" if driven else ""
        return [text, count, "-", "-"]
    return [
        mean_with_interval(driven),
        count,
        f"{np.mean([float(run['cte_mean_m']) for run in runs]):.2f}",
        f"{max(float(run['cte_max_m']) for run in runs):.2f}",
    ]


def mean_with_interval(percents: list[float]) -> str:
    """Return a mean of percents and its 95 % interval by Student's t, within 0..100.

    >>> mean_with_interval([90.0, 100.0, 95.0])
    '95.0 % (82.6 to 100.0)'
    >>> mean_with_interval([90.0])
    '90.0 %'
    """
    mean, count = float(np.mean(percents)), len(percents)
    if count < 2:
        return f"{mean:.1f} %"
    found = mean_over_seeds(mean, float(np.std(percents, ddof=1)), count, (0, 100))
    low, high = (mean, mean) if math.isnan(found.low) else (found.low, found.high)
    return f"{mean:.1f} % ({low:.1f} to {high:.1f})"


def frame_rate_plot(rows: list[dict]) -> Figure:
    """Plot recipe C's autonomy on the lake by frame rate: mean and range of the training seeds."""
    figure = Figure(figsize=(7, 3.6), layout="constrained")
    axis = figure.subplots()
    for data in dict.fromkeys(row["data"] for row in rows):
        by_rate: dict[float, list[float]] = {}
        for row in rows:
            if row["data"] == data and row["autonomy"]:
                by_rate.setdefault(float(row["frame_rate"]), []).append(
                    100 * float(row["autonomy"])
                )
        rates = sorted(by_rate)
        axis.plot(
            rates,
            [np.mean(by_rate[rate]) for rate in rates],
            color=COLOURS[data],
            marker="o",
            label=f"trained on: {DATA[data].replace('`', '')}",
        )
        low, high = ([ends(by_rate[rate]) for rate in rates] for ends in (min, max))
        axis.fill_between(rates, low, high, color=COLOURS[data], alpha=0.2, lw=0)
    axis.axvline(USUAL_RATE, color=GREY, ls="--", lw=1, label="rate of the expert's recording")
    axis.set_xscale("log")
    axis.set_xticks(rates, [f"{rate:g}" for rate in rates])
    axis.minorticks_off()
    axis.set(xlabel="frames per second in the drive", ylabel="autonomy, %", ylim=(-3, 103))
    axis.set_title(f"tiny41 on udacity_lake, {CONTROL}: mean and range of the training seeds")
    axis.legend(frameon=False, loc="best")
    axis.spines[["top", "right"]].set_visible(False)
    return figure

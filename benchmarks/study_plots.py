"""The plots of the studies, and the page of the board that sorts; a study's YAML names them."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from benchmarks.rank_correlations import (
    DRIVEN,
    METRICS,
    RECOVERIES,
    by_split,
    column,
    networks,
    rank_correlation,
)
from benchmarks.study_cells import (
    CELLS,
    DATA,
    floats,
    headline,
    largest_group,
    of_group,
    relative_errors,
)
from benchmarks.study_lines import Rows, grouped
from zoo.runs.plots import BLUE, GREY, ORANGE, save_figure

USUAL_RATE = 15.0  # Hz
MODELS = {"lenet": "#2a6fbb", "nvidia": "#d9822b", "tiny": "#3a9a5b", "tiny63": "#8a5bb0"} | {
    "commaai": "#c0392b",
    "linear": "#222222",
}


def lines(
    axis: Axes, by_label: dict[str, dict[float, list[float]]], colours: Sequence[str]
) -> None:
    """Plot for each label the mean of the values at each x, and the values as points."""
    ticks = sorted({x for values in by_label.values() for x in values})
    for (label, by_x), colour in zip(by_label.items(), colours, strict=False):
        xs = sorted(x for x in by_x if by_x[x])
        axis.plot(xs, [np.mean(by_x[x]) for x in xs], color=colour, label=label)
        for x in xs:
            axis.plot([x] * len(by_x[x]), by_x[x], "o", color=colour, ms=4)
    axis.set_xscale("log")
    axis.set_xticks(ticks, [f"{x:g}" for x in ticks])
    axis.minorticks_off()
    axis.spines[["top", "right"]].set_visible(False)


def percents(rows: Rows, key: str) -> list[float]:
    return [100 * share for share in floats(rows, key)]


def frame_rates(rows: Rows, path: Path) -> None:
    """Plot the 41-parameter network's autonomy on the lake by frame rate."""
    shown = [
        row
        for row in rows
        if (row["recipe"], row["control"], row["track"]) == ("C", "throttle 0.2", "udacity_lake")
    ]
    if len({row["frame_rate"] for row in shown}) < 2:
        return
    by_label = {
        f"trained on: {DATA[data[0]['data']].replace('`', '')}": {
            float(rate[0]["frame_rate"]): percents(rate, "autonomy")
            for rate in grouped(data, ["frame_rate"])
        }
        for data in grouped(shown, ["data"])
    }
    figure = Figure(figsize=(7, 3.6), layout="constrained")
    axis = figure.subplots()
    lines(axis, by_label, (BLUE, ORANGE))
    axis.axvline(USUAL_RATE, color=GREY, ls="--", lw=1, label="rate of the expert's recording")
    axis.set(xlabel="frames per second in the drive", ylabel="autonomy, %", ylim=(-3, 103))
    axis.set_title("tiny41 on udacity_lake, throttle 0.2: the training seeds and their mean")
    axis.legend(frameon=False, loc="best")
    save_figure(figure, path)


def transfer(rows: Rows, path: Path) -> None:
    """Plot validation error and autonomy by share of the recording, a line for each setting."""
    shown = largest_group(rows)
    figure = Figure(figsize=(12, 3.8), layout="constrained")
    panels: dict[str, Callable[[Rows], list[float]]] = {
        "validation error (always 0: 1)": relative_errors,
        "autonomy, %: udacity_lake (recorded)": lambda runs: percents(
            runs, "udacity_lake_autonomy"
        ),
        "autonomy, %: udacity_jungle (never seen)": lambda runs: percents(
            runs, "udacity_jungle_autonomy"
        ),
    }
    axes = figure.subplots(1, len(panels))
    for axis, (title, values) in zip(axes, panels.items(), strict=True):
        by_label = {
            setting[0]["setting"]: {
                100 * float(share[0]["share"]): values(share)
                for share in grouped(setting, ["share"])
            }
            for setting in grouped(shown, ["setting"])
        }
        lines(axis, by_label, ("black", GREY, ORANGE, BLUE))
        axis.set(title=title, xlabel="share of the training rows, %", xlim=(100 / 12, 120))
        axis.set_ylim((0, None) if values is relative_errors else (-3, 103))
    axes[0].legend(frameon=False, fontsize=8)
    seeds = len({row["seed"] for row in shown})
    figure.suptitle(
        f"EfficientNet-Lite0, {int(shown[0]['samples']):,} samples each, "
        f"{seeds} training seed{'s' * (seeds > 1)}",
        fontsize=10,
    )
    save_figure(figure, path)


def offline_metrics(rows: Rows, path: Path) -> None:
    """Plot metrics against driving: a line of plots for each split, and one for recoveries.

    Each line has two metrics against the mean error on the lake and the autonomy on the mountain.
    """
    panels = [
        (f"test rows, split {split}", own, {key: (METRICS[key], 1) for key in list(METRICS)[::2]})
        for split, own in by_split(rows).items()
    ]
    own = {key: RECOVERIES[key] for key in ("recoveries_mse", "recoveries_side_response")}
    panels.append(("recoveries", networks(rows), own))
    figure = Figure(figsize=(15, 3.6 * len(panels)), layout="constrained")
    axes = np.atleast_2d(figure.subplots(len(panels), 4))
    for line, (where, shown, metrics) in zip(axes, panels, strict=True):
        pairs = [(key, to) for to in ("lake_cte_mean_m", "mountain_autonomy") for key in metrics]
        for axis, (key, to) in zip(line, pairs, strict=True):
            (label, sign), (driven, worse) = metrics[key], DRIVEN[to]
            for model in grouped(shown, ["model"]):
                name = model[0]["model"]
                axis.scatter(
                    column(model, key),
                    column(model, to),
                    color=MODELS.get(name, GREY),
                    label=name,
                    s=28,
                    alpha=0.8,
                    lw=0,
                )
            value, *_ = rank_correlation(column(shown, key, sign), column(shown, to, worse))
            axis.set(
                xscale="log" if sign > 0 else "linear",  # a response may be negative
                xlabel=f"{label}, {where}",
                ylabel=driven + (" (m)" if to.endswith("_m") else ""),
                title=f"rank correlation {value:+.2f}",
            )
            if sign > 0:
                axis.xaxis.set_minor_formatter(NullFormatter())
            axis.spines[["top", "right"]].set_visible(False)
            axis.grid(alpha=0.2)
    marks = {}
    for axis in axes.flat:
        marks |= dict(zip(*reversed(axis.get_legend_handles_labels()), strict=True))
    figure.legend(marks.values(), marks.keys(), loc="outside upper center", ncols=len(marks))
    save_figure(figure, path)


def board_page(rows: Rows, path: Path) -> None:
    """Write the board as one self-contained HTML page whose columns sort."""
    from zoo.leaderboard.ranking_page import render_page

    groups = ("headline", "like", "sharp", "looks", "dynamics", "laps")
    more = ("m_per_intervention", "without_intervention", "cte_mean_m", "steering_per_s")
    figures = [(group, "autonomy") for group in groups]
    figures += [(group, figure) for group in groups[1:] for figure in more]
    cells: list[tuple[str, str, tuple[str, ...]]] = [
        ("entry", "text", ("entry",)),
        ("training", "text", ("training",)),
        ("network", "text", ("network",)),
        ("parameters", "trained", ("parameters",)),
        ("training seeds", "trained", ("training_seeds",)),
    ]
    for group, figure in figures:
        is_share = figure in ("autonomy", "without_intervention")
        heading = group if figure == "autonomy" else f"{group}: {figure}"
        cells.append((heading, "percent" if is_share else "number", (group, figure)))
    entries = sorted(grouped(rows, ["entry", "training"]), key=lambda rows: -headline(rows))
    lines = []
    for entry in entries:
        line: list[tuple[str, float | None]] = []
        for _, cell, arguments in cells:
            first = (
                entry[0][arguments[0]] if len(arguments) == 1 else of_group(entry, *arguments)[0]
            )
            value = float(first) if cell != "text" and first else None
            line.append((CELLS[cell](entry, *arguments), value))
        lines.append(line)
    axes = [
        {"key": group, "heading": group, "kind": "figure", "less": False, "share": True}
        for group in groups
    ]
    scripted = [
        {
            "name": f"{entry[0]['entry']} {entry[0]['training']}",
            "values": {row["group"]: float(row["autonomy"]) for row in entry if row["autonomy"]},
            "runs": [],
        }
        for entry in entries
    ]
    page = render_page(
        title="drivezoo-bench v1",
        where="docs/benchmark.csv",
        lead="Autonomy by group of roads, with 95 % intervals over roads and training seeds. "
        "Click a heading to sort.",
        heads=[(heading, cell == "text") for heading, cell, _ in cells],
        rows=lines,
        data={"axes": axes, "entries": scripted, "curves": []},
    )
    path.write_text(page)


PLOTS: dict[str, Callable[[Rows, Path], None]] = {
    "board_page": board_page,
    "frame_rates": frame_rates,
    "offline_metrics": offline_metrics,
    "transfer": transfer,
}

"""The plot of open-loop metrics, and the page of the board that sorts."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from benchmarks.rank_correlations import (
    DRIVEN,
    METRICS,
    by_split,
    column,
    networks,
    rank_correlation,
)
from benchmarks.study_csv import Rows, grouped
from benchmarks.study_tables import CELLS, headline, of_group
from zoo.runs.plots import GREY, save_figure

MODELS = {"lenet": "#2a6fbb", "nvidia": "#d9822b", "tiny": "#3a9a5b", "tiny63": "#8a5bb0"} | {
    "commaai": "#c0392b",
    "linear": "#222222",
}
GROUPS = ("like", "sharp", "looks", "dynamics", "laps")  # of the board's roads
FIGURES = ("m_per_intervention", "without_intervention", "cte_mean_m", "steering_per_s")


def offline_metrics(rows: Rows, path: Path) -> None:
    """Plot metrics against driving: a line of plots for each split, and one for recoveries.

    Each line has two metrics against the mean error on the lake and the autonomy on the mountain.
    """
    own_rows = ("test_mse", "test_balanced_mae")
    panels = [(f"test rows, split {name}", own, own_rows) for name, own in by_split(rows).items()]
    panels.append(("recoveries", networks(rows), ("recoveries_mse", "recoveries_side_response")))
    figure = Figure(figsize=(15, 3.6 * len(panels)), layout="constrained")
    axes = np.atleast_2d(figure.subplots(len(panels), 4))
    for line, (where, shown, metrics) in zip(axes, panels, strict=True):
        pairs = [(key, to) for to in ("lake_cte_mean_m", "mountain_autonomy") for key in metrics]
        for axis, (key, to) in zip(line, pairs, strict=True):
            (label, sign), (driven, worse) = METRICS[key], DRIVEN[to]
            for model in grouped(shown, ["model"]):
                name = model[0]["model"]
                look = {"color": MODELS.get(name, GREY), "label": name, "s": 28, "alpha": 0.8}
                axis.scatter(column(model, key), column(model, to), lw=0, **look)
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
    from zoo.leaderboard.ranking_page import PAGE

    # Heading, cell, and its arguments.
    cells = [(name, "text", f"{{{name}}}") for name in ("entry", "training", "network")]
    cells += [
        (name.replace("_", " "), "trained", name) for name in ("parameters", "training_seeds")
    ]
    cells += [(group, "percent", group, "autonomy") for group in ("headline", *GROUPS)]
    for group in GROUPS:
        for figure in FIGURES:
            cell = "percent" if figure == "without_intervention" else "number"
            cells.append((f"{group}: {figure}", cell, group, figure))
    entries = sorted(grouped(rows, ["entry", "training"]), key=lambda rows: -headline(rows))
    lines, scripted = [], []
    for entry in entries:
        line: list[tuple[str, float | None]] = []
        for _, cell, *given in cells:
            value = of_group(entry, *given)[0] if len(given) > 1 else entry[0].get(given[0])
            line.append((CELLS[cell](entry, *given), float(value) if value else None))
        lines.append(line)
        name = f"{entry[0]['entry']} {entry[0]['training']}"
        values = {row["group"]: float(row["autonomy"]) for row in entry if row["autonomy"]}
        scripted.append({"name": name, "values": values, "runs": []})
    axes = [
        {"key": group, "heading": group, "kind": "figure", "less": False, "share": True}
        for group in ("headline", *GROUPS)
    ]
    page = PAGE.render(
        title="drivezoo-bench v1",
        where="docs/benchmark.csv",
        lead="Autonomy by group of roads, with 95 % intervals over roads and training seeds. "
        "Click a heading to sort.",
        heads=[(heading, cell == "text") for heading, cell, *_ in cells],
        rows=lines,
        data={"axes": axes, "entries": scripted, "curves": []},
        unranked=[],
    )
    path.write_text(page)


PLOTS: dict[str, Callable[[Rows, Path], None]] = {
    "board_page": board_page,
    "offline_metrics": offline_metrics,
}

"""Rank correlations of open-loop metrics with driving, the texts of the study offline_metrics."""

import math
from collections.abc import Iterable

import numpy as np
from scipy.stats import spearmanr

from benchmarks.measuring import markdown_table
from benchmarks.study_lines import Row, Rows, grouped

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
RESAMPLINGS, FEWEST = 2_000, 8


def networks(rows: Rows) -> list[Row]:
    """Return the driven networks, each once.

    If the first epoch was the best, a longer training has the same network.
    """
    driven = [row for row in rows if row["lake_autonomy"]]
    return list({tuple(abs_of(row, key) for key in METRICS): row for row in driven}.values())


def abs_of(row: Row, key: str) -> float:
    """Return a figure; the bias without its sign."""
    return abs(float(row[key])) if key == "test_bias" else float(row[key])


def column(rows: Rows, key: str, sign: int = 1) -> np.ndarray:
    """Return a column as float64 [N], larger where it is worse."""
    return sign * np.array([abs_of(row, key) for row in rows])


def rank_correlation(offline: np.ndarray, driven: np.ndarray) -> tuple[float, float, float]:
    """Return Spearman's correlation and its 95 % interval; NaN if all drives are equal."""
    if len(set(driven)) < 2:
        return math.nan, math.nan, math.nan
    rng, drawn = np.random.default_rng(0), []
    for _ in range(RESAMPLINGS):
        chosen = rng.integers(0, len(offline), len(offline))
        if len(set(offline[chosen])) > 1 and len(set(driven[chosen])) > 1:
            drawn.append(spearmanr(offline[chosen], driven[chosen]).statistic)
    low, high = np.quantile(drawn, [0.025, 0.975])
    return float(spearmanr(offline, driven).statistic), float(low), float(high)


def by_split(rows: Rows) -> dict[str, list[Row]]:
    """Return the networks of each split that has at least `FEWEST`."""
    groups = {group[0]["split"]: group for group in grouped(networks(rows), ["split"])}
    return {name: group for name, group in groups.items() if len(group) >= FEWEST}


def correlation_table(name: str, lines: Iterable[tuple[list[str], Rows, str, int]]) -> str:
    """Return a Markdown table of rank correlations.

    Args:
        name: heading of the metrics.
        lines: first cells of each line, its networks, its metric and the metric's sign.
    """
    cells = []
    for first, rows, metric, sign in lines:
        found = [
            rank_correlation(column(rows, metric, sign), column(rows, key, worse))
            for key, (_, worse) in DRIVEN.items()
        ]
        shown = [f"{value:+.2f} ({low:+.2f} to {high:+.2f})" for value, low, high in found]
        cells.append([*first, str(len(rows)), *shown])
    labels = [label for label, _ in DRIVEN.values()]
    more = ["split"] * (len(cells[0]) - len(labels) - 2)
    head = [name, *more, "networks", *labels]
    return markdown_table(head, cells, left=1 + len(more))


def test_rows(rows: Rows) -> str:
    """Return a line for each metric of a network's own test rows, and split."""
    return correlation_table(
        "metric on the test rows",
        (
            ([label, split], own, metric, 1)
            for metric, label in METRICS.items()
            for split, own in by_split(rows).items()
        ),
    )


def recoveries(rows: Rows) -> str:
    """Return a line for each metric of the recoveries, over all networks."""
    return correlation_table(
        "metric on the recoveries",
        (([label], networks(rows), metric, sign) for metric, (label, sign) in RECOVERIES.items()),
    )

"""Rank correlations of open-loop metrics with driving, the texts of the study offline_metrics."""

import math

import numpy as np
from scipy.stats import spearmanr

from benchmarks.measuring import Rows, TextRow, grouped, markdown_table

# Metrics on a network's own test rows and on the recording of recoveries, and the sign with which a
# larger value is worse.
METRICS = {
    "test_mse": ("MSE", 1),
    "test_mae": ("MAE", 1),
    "test_balanced_mae": ("balanced MAE", 1),
    "test_bias": ("absolute bias", 1),
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


def networks(rows: Rows) -> list[TextRow]:
    """Return the driven networks, each once.

    If the first epoch was the best, a longer training has the same network.
    """
    driven = [row for row in rows if row["lake_autonomy"]]
    own = [key for key in METRICS if key.startswith("test_")]
    return list({tuple(abs_of(row, key) for key in own): row for row in driven}.values())


def abs_of(row: TextRow, key: str) -> float:
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


def by_split(rows: Rows) -> dict[str, list[TextRow]]:
    """Return the networks of each split that has at least `FEWEST`."""
    groups = {group[0]["split"]: group for group in grouped(networks(rows), ["split"])}
    return {name: group for name, group in groups.items() if len(group) >= FEWEST}


def correlation_table(rows: Rows, where: str, head: list[str]) -> str:
    """Return a Markdown table with a line for each metric on some rows, and split of those."""
    lines = []
    groups = by_split(rows) if "split" in head else {"": networks(rows)}
    for metric, (label, sign) in METRICS.items():
        for split, own in groups.items() if metric.startswith(where) else ():
            cells = [label, split, str(len(own))] if split else [label, str(len(own))]
            for key, (_, worse) in DRIVEN.items():
                found = rank_correlation(column(own, metric, sign), column(own, key, worse))
                cells.append("{:+.2f} ({:+.2f} to {:+.2f})".format(*found))
            lines.append(cells)
    labels = [label for label, _ in DRIVEN.values()]
    return markdown_table([*head, "networks", *labels], lines, left=len(head))


def test_rows(rows: Rows) -> str:
    """Return a line for each metric of a network's own test rows, and split."""
    return correlation_table(rows, "test_", ["metric on the test rows", "split"])


def recoveries(rows: Rows) -> str:
    """Return a line for each metric of the recoveries, over all networks."""
    return correlation_table(rows, "recoveries_", ["metric on the recoveries"])

"""Rank correlations of open-loop metrics with driving: the tables of the study offline_metrics."""

import math
from collections.abc import Sequence

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
ALTERED = ("camera", "offset")  # words of the settings that alter the side cameras


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


def rank_correlation(
    offline: np.ndarray, driven: np.ndarray, recipes: Sequence[object] | None = None
) -> tuple[float, float, float]:
    """Return Spearman's correlation and its 95 % interval; NaN if all figures are equal.

    Recipes are drawn again, each with all of its training seeds: these are alike. Without recipes,
    each network is one.
    """
    if min(len(set(offline)), len(set(driven))) < 2:
        return math.nan, math.nan, math.nan
    rng, drawn = np.random.default_rng(0), []
    recipes = range(len(offline)) if recipes is None else recipes
    of_recipes = [np.flatnonzero(np.array(recipes) == one) for one in dict.fromkeys(recipes)]
    for _ in range(RESAMPLINGS):
        places = rng.integers(0, len(of_recipes), len(of_recipes))
        chosen = np.concatenate([of_recipes[place] for place in places])
        if len(set(offline[chosen])) > 1 and len(set(driven[chosen])) > 1:
            drawn.append(spearmanr(offline[chosen], driven[chosen]).statistic)
    low, high = np.quantile(drawn, [0.025, 0.975])
    return float(spearmanr(offline, driven).statistic), float(low), float(high)


def correlation_table(rows: Rows, where: str, head: list[str]) -> str:
    """Return a Markdown table with a line for each metric on some rows, and split of those.

    A second one is of the networks whose side cameras are the usual ones.
    """
    driven = networks(rows)
    usual = [row for row in driven if not any(word in row["setting"] for word in ALTERED)]
    tables = [_correlations(own, where, head) for own in (driven, usual)]
    left_out = len(driven) - len(usual)
    return f"\n\nWithout the {left_out} networks with altered cameras:\n\n".join(tables)


def _correlations(driven: Rows, where: str, head: list[str]) -> str:
    lines, groups = [], {"": driven}
    if "split" in head:
        of_splits = grouped(driven, ["split"])
        groups = {group[0]["split"]: group for group in of_splits if len(group) >= FEWEST}
    for metric, (label, sign) in METRICS.items():
        for split, own in groups.items() if metric.startswith(where) else ():
            recipes = [" ".join([row["model"], row["setting"], row["split"]]) for row in own]
            counts = [str(len(own)), str(len(set(recipes)))]
            cells = [label, split, *counts] if split else [label, *counts]
            for key, (_, worse) in DRIVEN.items():
                pair = column(own, metric, sign), column(own, key, worse)
                cells.append(
                    "{:+.2f} ({:+.2f} to {:+.2f})".format(*rank_correlation(*pair, recipes))
                )
            lines.append(cells)
    labels = [label for label, _ in DRIVEN.values()]
    return markdown_table([*head, "networks", "recipes", *labels], lines, left=len(head))

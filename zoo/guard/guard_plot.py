"""Plot of a guard: the distribution of each score."""

import numpy as np
from matplotlib.figure import Figure

from zoo.guard.conditions import WEATHER
from zoo.guard.guard_result import GuardResult, of_group
from zoo.guard.labelled_windows import LEADS_S
from zoo.runs.plots import BLUE, GREY, ORANGE


def score_histograms(result: GuardResult) -> Figure:
    """Plot each score's distribution: nominal windows, and windows before failures in weather."""
    scores = result.fitted.scores
    lead = LEADS_S[0]
    figure = Figure(figsize=(11, 0.6 + 2.1 * -(-len(scores) // 2)), layout="constrained")
    axes = figure.subplots(-(-len(scores) // 2), 2, squeeze=False).ravel()
    for axis, method in zip(axes, scores, strict=False):
        threshold = result.fitted.thresholds[method].value
        nominal = _joined([one.normal[method] for one in result.fitted.nominal])
        drives = of_group(result.shifted, WEATHER)
        before = _joined([one.before[method][lead] for one in drives])
        both = np.concatenate([nominal, before])
        most = float(np.quantile(both, 0.99)) if len(both) else threshold
        bins = np.linspace(0, max(most, 1.2 * threshold), 40)
        for values, colour, name in (
            (nominal, GREY, f"nominal ({len(nominal)})"),
            (before, BLUE, f"{lead} s before a failure ({len(before)})"),
        ):
            if len(values):
                share = np.full(len(values), 100 / len(values))
                held = np.minimum(values, bins[-1])
                axis.hist(held, bins, weights=share, color=colour, alpha=0.6, label=name)
        axis.axvline(threshold, color=ORANGE, lw=1.5, label="threshold")
        axis.set_title(method)
        axis.set_ylabel("% of windows")
        axis.spines[["top", "right"]].set_visible(False)
    for axis in axes[len(scores) :]:
        axis.axis("off")
    axes[0].legend(frameon=False, fontsize=8)
    figure.supxlabel("mean score of a window of 1 s")
    return figure


def _joined(parts: list[np.ndarray]) -> np.ndarray:
    return np.concatenate([np.zeros(0), *parts])

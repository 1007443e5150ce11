"""The result of a guard as tables, sentences and a plot."""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from zoo.drives.bootstrap import Estimate, bootstrap, mean
from zoo.guard.conditions import DEGRADED, WEATHER
from zoo.guard.guard_result import NOMINAL, GuardResult, Pairs, of_group
from zoo.guard.labelled_windows import LEADS_S
from zoo.guard.warning_figures import FIGURES
from zoo.runs.plots import BLUE, GREY, ORANGE
from zoo.runs.table import Column, Table, interval_column, with_interval

TABLE_COLUMNS = ("group", "score", "lead_s", *FIGURES)
HEADINGS = ("recall %", "precision %", "false alarms %", "F3 %", "AUC %")
# Published figures on the original simulator, in percent.
# ThirdEye, Stocco et al. 2022, "ThirdEye: attention maps for safe autonomous driving systems";
# levels of weather; method, seconds before the failure, recall, precision, false-positive rate, F3.
THIRDEYE = (
    ("attention maps", 1, 92, 49, 4, 84),
    ("autoencoder on the image", 1, 100, 24, 7, 75),
)
LINES = (
    "ThirdEye's best F3 3 s ahead: 79",
    "Grewal et al. 2024, Monte-Carlo dropout: AUC 84 %",
)
TITLES = {WEATHER: "Fog, rain and light", DEGRADED: "Degraded networks"}


def warnings_table(result: GuardResult, only: str | None = None) -> Table:
    """Return a row for each group of conditions, method and lead; a CSV file has shares as 0..1.

    Args:
        result: result of the command.
        only: the only group, whose name is then the title; None for all groups.
    """
    found = [
        (group, method, lead, figures)
        for group, by_method in result.figures.items()
        for method, by_lead in by_method.items()
        for lead, figures in by_lead.items()
        if only in (None, group)
    ]
    leads = [lead for _, _, lead, _ in found]
    methods = [method for _, method, _, _ in found]
    if only is not None:  # each method is named once
        pairs = zip(methods, leads, strict=True)
        methods = [method if lead == LEADS_S[0] else "" for method, lead in pairs]
    columns = [
        Column("group", "group", [group for group, *_ in found]),
        Column("score", "score", methods),
        Column("lead_s", "lead s", list(map(str, leads)), {"lead_s": leads}),
    ]
    for name, heading in zip(FIGURES, HEADINGS, strict=True):
        figures = [one[name] for *_, one in found]
        columns.append(interval_column(name, heading, figures, "{:.0f}", 100))
    if only is not None:
        return Table(columns[1:], TITLES[only])
    return Table(columns, "Warnings before failures, in brackets 95 % intervals over drives.")


def published_table() -> Table:
    """Return the figures of ThirdEye on the original simulator."""
    rows = [
        [name, str(lead), str(recall), str(precision), str(rate), str(f3), ""]
        for name, lead, recall, precision, rate, f3 in THIRDEYE
    ]
    title = "Published (ThirdEye, levels of weather in the original simulator)"
    return Table.of(["score", "lead s", *HEADINGS], rows, title)


def score_table(result: GuardResult) -> Table:
    """Return the threshold and the cost of each score, and its alarms without a failure."""
    fitted = result.fitted
    groups = [group for group in (WEATHER, DEGRADED) if group in result.figures]
    rows = [
        [
            method,
            f"{threshold.value:.3g}",
            f"{fitted.signal_ms[method]:.1f}",
            *(_percent(result.shifted_alarms[group][method]) for group in groups),
        ]
        for method, threshold in fitted.thresholds.items()
    ]
    names = [f"alarms without a failure, {group} %" for group in groups]
    return Table.of(["score", "threshold", "ms per frame", *names], rows, "Scores")


def pair_table(pairs: Pairs) -> Table:
    """Return the interventions without a guard, with it, and at its mean speed."""
    kinds = list(dict.fromkeys(one.kind for one in pairs.conditions))
    rows = []
    for kind in [*kinds, "all"]:
        own = [row for row, one in enumerate(pairs.conditions) if kind in (one.kind, "all")]
        counts = [
            str(sum(drives[row].interventions for row in own))
            for drives in (pairs.without, pairs.guarded, pairs.slower)
        ]
        alarms = str(sum(pairs.guarded[row].alarms for row in own))
        speed = f"{np.mean([pairs.guarded[row].speed_mph for row in own]):.1f}"
        rows.append([kind, str(len(own)), *counts, alarms, speed])
    headings = ["condition", "drives", "without", "with the guard", "at its mean speed"]
    return Table.of([*headings, "alarms", "mean speed, mph"], rows, "Interventions")


def prevented(pairs: Pairs) -> tuple[Estimate, Estimate]:
    """Return the interventions prevented per drive by the guard, and by its mean speed alone."""
    counts = [
        np.array([one.interventions for one in drives], float)
        for drives in (pairs.without, pairs.guarded, pairs.slower)
    ]
    without, guarded, slower = counts
    return bootstrap((without - guarded)[None], mean), bootstrap((without - slower)[None], mean)


def prevented_line(pairs: Pairs) -> str:
    """Return a sentence about the interventions that the guard prevented."""
    guard, slower = prevented(pairs)
    without, guarded = (
        sum(one.interventions for one in drives) for drives in (pairs.without, pairs.guarded)
    )
    alarms = sum(one.alarms for one in pairs.guarded)
    return (
        f"{without} interventions without the guard, {guarded} with it, after {alarms} alarms: "
        f"prevented per drive {with_interval(guard, '{:.2f}')}; the same mean speed without a "
        f"guard prevents {with_interval(slower, '{:.2f}')}"
    )


def failure_line(result: GuardResult) -> str:
    """Return a sentence about the drives, their failures and windows."""
    parts = []
    for group in (NOMINAL, WEATHER, DEGRADED):
        drives = result.fitted.nominal if group == NOMINAL else of_group(result.shifted, group)
        if drives:
            failures = sum(one.windows.failures for one in drives)
            parts.append(f"{group}: {failures} in {len(drives)} drives")
    late = {lead: sum(one.windows.late[lead] for one in result.shifted) for lead in LEADS_S}
    soon = ", ".join(f"{count} at {lead} s" for lead, count in late.items())
    normal = sum(len(one.windows.normal) for one in result.fitted.nominal)
    return (
        f"failures: {'; '.join(parts)}; left out because the car started too shortly before: "
        f"{soon}; nominal windows: {normal}"
    )


def method_line(result: GuardResult) -> str:
    """Return a sentence about the guard file's score."""
    fitted, method = result.fitted, result.method
    return (
        f"the guard file uses {method}, which takes {fitted.signal_ms[method]:.1f} ms per frame, "
        f"and slows down to {result.options.slow:g} mph"
    )


def all_tables(result: GuardResult) -> Sequence[Table]:
    """Return the tables in the order of the terminal and the page; a caption is the title."""
    failed = {one.condition.group for one in result.shifted if one.windows.failures}
    tables = [warnings_table(result, group) for group in result.figures if group in failed]
    tables += [published_table(), score_table(result)]
    return [*tables, *([] if result.pairs is None else [pair_table(result.pairs)])]


def _percent(share: float) -> str:
    return f"{100 * share:.0f}" if math.isfinite(share) else "-"


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

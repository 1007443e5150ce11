"""The result of a guard as tables of texts, for the terminal and the page."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from zoo.drives.bootstrap import Estimate, bootstrap, mean
from zoo.guard.conditions import DEGRADED, WEATHER
from zoo.guard.guard_result import NOMINAL, GuardResult, Pairs, of_group
from zoo.guard.labelled_windows import LEADS_S
from zoo.guard.published import THIRDEYE
from zoo.guard.warning_figures import FIGURES
from zoo.runs.result_table import ResultTable, TableColumn
from zoo.runs.table_text import interval_figures, with_interval

TABLE_COLUMNS = ("group", "score", "lead_s", *FIGURES)
HEADINGS = ("recall %", "precision %", "false alarms %", "F3 %", "AUC %")
TITLES = {WEATHER: "Fog, rain and light", DEGRADED: "Degraded networks"}


@dataclass(frozen=True)
class Cells:
    """A table of texts.

    Attributes:
        title: title.
        headings: headings of the columns.
        rows: cells of each row.
    """

    title: str
    headings: list[str]
    rows: list[list[str]]


def warning_table(result: GuardResult, group: str) -> Cells:
    """Return the figures of a group of conditions: a row for each method and lead."""
    rows = []
    for method, by_lead in result.figures[group].items():
        for lead, figures in by_lead.items():
            texts = [with_interval(figures[name], "{:.0f}", 100) for name in FIGURES]
            rows.append([method if lead == LEADS_S[0] else "", str(lead), *texts])
    return Cells(TITLES[group], ["score", "lead s", *HEADINGS], rows)


def all_warnings(result: GuardResult) -> ResultTable:
    """Return the figures of all groups as one table for a file, shares as 0..1."""
    found = [
        (group, method, lead, figures)
        for group, by_method in result.figures.items()
        for method, by_lead in by_method.items()
        for lead, figures in by_lead.items()
    ]
    columns = [
        TableColumn("group", "group", [one for one, *_ in found]),
        TableColumn("score", "score", [one for _, one, *_ in found]),
        TableColumn(
            "lead_s",
            "lead s",
            [str(one[2]) for one in found],
            {"lead_s": [one[2] for one in found]},
        ),
    ]
    for name, heading in zip(FIGURES, HEADINGS, strict=True):
        figures = [one[-1][name] for one in found]
        texts = [with_interval(one, "{:.0f}", 100) for one in figures]
        columns.append(TableColumn(name, heading, texts, interval_figures(name, figures)))
    return ResultTable(columns, "Warnings before failures, in brackets 95 % intervals over drives.")


def published_table() -> Cells:
    """Return the figures of ThirdEye on the original simulator."""
    rows = [
        [name, str(lead), str(recall), str(precision), str(rate), str(f3), ""]
        for name, lead, recall, precision, rate, f3 in THIRDEYE
    ]
    title = "Published (ThirdEye, levels of weather in the original simulator)"
    return Cells(title, ["score", "lead s", *HEADINGS], rows)


def score_table(result: GuardResult) -> Cells:
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
    return Cells("Scores", ["score", "threshold", "ms per frame", *names], rows)


def pair_table(pairs: Pairs) -> Cells:
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
    return Cells("Interventions", [*headings, "alarms", "mean speed, mph"], rows)


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


def all_tables(result: GuardResult) -> Sequence[Cells]:
    """Return the tables in the order of the terminal and the page."""
    failed = {one.condition.group for one in result.shifted if one.windows.failures}
    tables = [warning_table(result, group) for group in result.figures if group in failed]
    tables += [published_table(), score_table(result)]
    return [*tables, *([] if result.pairs is None else [pair_table(result.pairs)])]


def _percent(share: float) -> str:
    return f"{100 * share:.0f}" if math.isfinite(share) else "-"

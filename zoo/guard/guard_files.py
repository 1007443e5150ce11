"""The result of a guard as tables, sentences, a plot, and the files that hold them."""

import math
from dataclasses import asdict
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from rich.box import SIMPLE_HEAD
from rich.console import Console

from zoo.base.bounded_files import hash_file
from zoo.base.terminal import printable
from zoo.base.whole_file import json_text, write_whole
from zoo.drives.bootstrap import bootstrap
from zoo.guard.conditions import DEGRADED, NOMINAL, WEATHER
from zoo.guard.guard_drives import GuardResult, ScoredDrive, joined, of_group
from zoo.guard.warning_figures import FIGURES, LEADS_S
from zoo.monitor.scores import METHODS
from zoo.report import blocks
from zoo.runs.code_fingerprint import code_fingerprint
from zoo.runs.plots import BLUE, GREY, ORANGE, save_figure
from zoo.runs.table import Column, Table, interval_column, with_interval

VERSION = 1
JSON, PAGE, PLOT = "guard.json", "guard.html", "guard.png"
CAPTION = (
    "Windows of 1 s that end 1, 2 and 3 s before a failure, against windows of held-out nominal "
    "drives. In brackets: 95 % interval, bootstrap over drives. Precision depends on how many "
    "nominal windows there are."
)
TABLE_COLUMNS = ("group", "score", "lead_s", *FIGURES)
HEADINGS = ("recall %", "precision %", "false alarms %", "F3 %", "AUC %")
# Published figures on the original simulator, in percent.
# ThirdEye, Stocco et al. 2022, "ThirdEye: attention maps for safe autonomous driving systems";
# levels of weather; method, seconds before the failure, recall, precision, false-positive rate, F3.
THIRDEYE = (
    ("attention maps", "1", "92", "49", "4", "84"),
    ("autoencoder on the image", "1", "100", "24", "7", "75"),
)
LINES = (
    "ThirdEye's best F3 3 s ahead: 79",
    "Grewal et al. 2024, Monte-Carlo dropout: AUC 84 %",
)
TITLES = {WEATHER: "Fog, rain and light", DEGRADED: "Degraded networks"}


def write_files(folder: Path, result: GuardResult) -> list[Path]:
    """Write the files and return their paths."""
    plot = save_figure(score_histograms(result), folder / PLOT)
    return [
        write_whole(folder / JSON, json_text(plain_result(result))),
        write_whole(folder / PAGE, _page(result, plot)),
        plot,
    ]


def plain_result(result: GuardResult) -> dict:
    """Return the content of `guard.json`."""
    warnings: dict[str, dict[str, dict]] = {}
    for group, method, lead, figures in result.figures:
        by_lead = warnings.setdefault(group, {}).setdefault(method, {})
        by_lead[str(lead)] = {name: asdict(one) for name, one in figures.items()}
    return {
        "version": VERSION,
        "code": code_fingerprint(),
        "checkpoint": {"file": result.checkpoint, "sha256": hash_file(result.checkpoint)},
        "options": asdict(result.options),
        "scores": {
            method: {
                "source": METHODS[method].source,
                "ms_per_frame": fitted.frame_ms,
                "threshold": asdict(fitted.threshold),
                "alarms_without_failure": {
                    group: result.alarms_without_failure(group, method)
                    for group in (WEATHER, DEGRADED)
                },
            }
            for method, fitted in result.fitted.items()
        },
        "warnings": warnings,
        "drives": [_plain_drive(one) for one in result.drives],
        "guard": result.method,
        "paired": result.pairs,
        "notes": result.notes,
    }


def print_result(result: GuardResult, console: Console) -> None:
    """Print the tables and sentences."""
    style = {"box": SIMPLE_HEAD, "show_edge": False, "pad_edge": False, "padding": (0, 1, 0, 0)}
    for table in all_tables(result):
        shown = table.narrow().printed(left=1, whole=[0], title=table.caption, **style)
        shown.title_justify = "left"
        console.print(shown)
    for line in _lines(result):
        console.print(printable(line), highlight=False, markup=False, soft_wrap=True)


def _lines(result: GuardResult) -> list[str]:
    return [CAPTION, *result.notes, *sentences(result)]


def _page(result: GuardResult, plot: Path) -> str:
    caption = "Scores of nominal windows and of windows 1 s before a failure in weather and light"
    image = blocks.Image(PLOT, plot.read_bytes(), caption, plot=True)
    sections = [
        blocks.Section("Guard", [blocks.Text(one) for one in _lines(result)]),
        *(blocks.Section(one.caption, [blocks.Rows(one)]) for one in all_tables(result)),
        blocks.Section("Distributions", [blocks.Images([image])]),
    ]
    title = f"Warnings before failures: {Path(result.checkpoint).name}"
    code = code_fingerprint()
    footer = f"{result.checkpoint}; code {code.get('commit') or code.get('hash')}"
    return blocks.to_html(title, sections, footer)


def _plain_drive(drive: ScoredDrive) -> dict:
    windows, condition = drive.windows, drive.condition
    return {
        "group": condition.group,
        "kind": condition.kind,
        "level": condition.level,
        "noise": condition.noise,
        "weather": str(condition.scenario.weather),
        "seed": condition.scenario.seed,
        "driven_m": drive.driven_m,
        "failures": windows.failures,
        "late": {str(lead): count for lead, count in windows.late.items()},
        "normal_windows": len(windows.normal),
    }


def warnings_table(result: GuardResult, only: str | None = None) -> Table:
    """Return a row for each group of conditions, method and lead; a CSV file has shares as 0..1.

    Args:
        result: result of the command.
        only: the only group, whose name is then the title; None for all groups.
    """
    found = [one for one in result.figures if only in (None, one.group)]
    leads = [one.lead_s for one in found]
    # With a title, each method is named once.
    methods = ["" if only and one.lead_s != LEADS_S[0] else one.method for one in found]
    columns = [
        Column("group", "group", [one.group for one in found]),
        Column("score", "score", methods),
        Column("lead_s", "lead s", list(map(str, leads)), {"lead_s": leads}),
    ]
    for name, heading in zip(FIGURES, HEADINGS, strict=True):
        figures = [one.figures[name] for one in found]
        columns.append(interval_column(name, heading, figures, "{:.0f}", 100))
    if only is not None:
        return Table(columns[1:], TITLES[only])
    return Table(columns, "Warnings before failures, in brackets 95 % intervals over drives.")


def all_tables(result: GuardResult) -> list[Table]:
    """Return the tables in the order of the terminal and the page; a caption is the title."""
    groups = [one for one in (WEATHER, DEGRADED) if of_group(result.drives, one)]
    failed = {one.condition.group for one in result.drives if one.windows.failures}
    tables = [warnings_table(result, group) for group in groups if group in failed]
    title = "Published (ThirdEye, levels of weather in the original simulator)"
    tables.append(Table.of(["score", "lead s", *HEADINGS], [[*one, ""] for one in THIRDEYE], title))
    rows = [
        [
            method,
            f"{fitted.threshold.value:.3g}",
            f"{fitted.frame_ms:.1f}",
            *(_percent(result.alarms_without_failure(group, method)) for group in groups),
        ]
        for method, fitted in result.fitted.items()
    ]
    names = [f"alarms without a failure, {group} %" for group in groups]
    tables.append(Table.of(["score", "threshold", "ms per frame", *names], rows, "Scores"))
    return [*tables, *([] if result.pairs is None else [pair_table(result.pairs)])]


def pair_table(pairs: list[dict]) -> Table:
    """Return the interventions without a guard, with it, and at its mean speed."""
    kinds = [one["condition"].split()[0] for one in pairs]
    rows = []
    for kind in [*dict.fromkeys(kinds), "all"]:
        own = [one for one, its_kind in zip(pairs, kinds, strict=True) if kind in (its_kind, "all")]
        counts = [
            str(sum(one[which]["interventions"] for one in own))
            for which in ("without", "guarded", "slower")
        ]
        alarms = str(sum(one["guarded"]["alarms"] for one in own))
        speed = f"{np.mean([one['guarded']['speed_mph'] for one in own]):.1f}"
        rows.append([kind, str(len(own)), *counts, alarms, speed])
    headings = ["condition", "drives", "without", "with the guard", "at its mean speed"]
    return Table.of([*headings, "alarms", "mean speed, mph"], rows, "Interventions")


def sentences(result: GuardResult) -> list[str]:
    """Return sentences about publications, failures, the guard's score and what it prevented."""
    groups = {one: of_group(result.drives, one) for one in (NOMINAL, WEATHER, DEGRADED)}
    failures = "; ".join(
        f"{group}: {sum(one.windows.failures for one in drives)} in {len(drives)} drives"
        for group, drives in groups.items()
        if drives
    )
    shifted = [*groups[WEATHER], *groups[DEGRADED]]
    late = {lead: sum(one.windows.late[lead] for one in shifted) for lead in LEADS_S}
    soon = ", ".join(f"{count} at {lead} s" for lead, count in late.items())
    normal = sum(len(one.windows.normal) for one in groups[NOMINAL])
    lines = [
        *LINES,
        f"failures: {failures}; left out because the car started too shortly before: {soon}; "
        f"nominal windows: {normal}",
        f"the guard file uses {result.method}, which takes "
        f"{result.fitted[result.method].frame_ms:.1f} ms per frame, and slows down to "
        f"{result.options.slow:g} mph",
    ]
    if result.pairs is None:
        return lines
    without, guarded, slower = (
        np.array([one[which]["interventions"] for one in result.pairs], float)
        for which in ("without", "guarded", "slower")
    )
    by_guard, by_speed = (
        with_interval(bootstrap(without - one), "{:.2f}") for one in (guarded, slower)
    )
    alarms = sum(one["guarded"]["alarms"] for one in result.pairs)
    prevented = (
        f"{without.sum():.0f} interventions without the guard, {guarded.sum():.0f} with it, after "
        f"{alarms} alarms: prevented per drive {by_guard}; the same mean speed without a guard "
        f"prevents {by_speed}"
    )
    return [*lines, prevented]


def _percent(share: float) -> str:
    return f"{100 * share:.0f}" if math.isfinite(share) else "-"


def score_histograms(result: GuardResult) -> Figure:
    """Plot each score's distribution: nominal windows, and windows before failures in weather."""
    lead, rows = LEADS_S[0], -(-len(result.fitted) // 2)
    figure = Figure(figsize=(11, 0.6 + 2.1 * rows), layout="constrained")
    axes = figure.subplots(rows, 2, squeeze=False).ravel()
    for axis, (method, fitted) in zip(axes, result.fitted.items(), strict=False):
        threshold = fitted.threshold.value
        nominal = joined([one.normal[method] for one in of_group(result.drives, NOMINAL)])
        before = joined([one.before[method][lead] for one in of_group(result.drives, WEATHER)])
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
    for axis in axes[len(result.fitted) :]:
        axis.axis("off")
    axes[0].legend(frameon=False, fontsize=8)
    figure.supxlabel("mean score of a window of 1 s")
    return figure

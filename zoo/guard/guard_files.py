"""The files of a guard: guard.json, guard.html and guard.png; and its tables in the terminal."""

from dataclasses import asdict
from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.console import Console

from zoo.base.regular_file import hash_file
from zoo.base.terminal import printable
from zoo.base.whole_file import json_text, write_whole
from zoo.guard import guard_tables
from zoo.guard.guard_drives import ScoredDrive
from zoo.guard.guard_result import GuardResult
from zoo.monitor.scores import METHODS
from zoo.report import blocks
from zoo.runs.code_fingerprint import code_fingerprint
from zoo.runs.plots import save_figure

VERSION = 1
JSON, PAGE, PLOT = "guard.json", "guard.html", "guard.png"
CAPTION = (
    "Windows of 1 s that end 1, 2 and 3 s before a failure, against windows of held-out nominal "
    "drives. In brackets: 95 % interval, bootstrap over drives. Precision depends on how many "
    "nominal windows there are."
)


def write_files(folder: Path, result: GuardResult) -> list[Path]:
    """Write the files and return their paths."""
    plot = save_figure(guard_tables.score_histograms(result), folder / PLOT)
    return [
        write_whole(folder / JSON, json_text(plain_result(result))),
        write_whole(folder / PAGE, _page(result, plot)),
        plot,
    ]


def plain_result(result: GuardResult) -> dict:
    """Return the content of `guard.json`."""
    pairs = result.pairs
    return {
        "version": VERSION,
        "code": code_fingerprint(),
        "checkpoint": {"file": result.checkpoint, "sha256": hash_file(result.checkpoint)},
        "options": asdict(result.options),
        "scores": {
            method: {
                "source": METHODS[method].source,
                "ms_per_frame": result.fitted.signal_ms[method],
                "threshold": asdict(threshold),
                "alarms_without_failure": {
                    group: by_method[method] for group, by_method in result.shifted_alarms.items()
                },
            }
            for method, threshold in result.fitted.thresholds.items()
        },
        "warnings": {
            group: {
                method: {
                    str(lead): {name: asdict(one) for name, one in figures.items()}
                    for lead, figures in by_lead.items()
                }
                for method, by_lead in by_method.items()
            }
            for group, by_method in result.figures.items()
        },
        "drives": [_plain_drive(one) for one in [*result.fitted.nominal, *result.shifted]],
        "guard": result.method,
        "paired": None
        if pairs is None
        else [
            {"condition": one.name, "without": asdict(first), "guarded": asdict(second)}
            | {"slower": asdict(third)}
            for one, first, second, third in zip(
                pairs.conditions, pairs.without, pairs.guarded, pairs.slower, strict=True
            )
        ],
        "notes": result.notes,
    }


def print_result(result: GuardResult, console: Console) -> None:
    """Print the tables and sentences."""
    style = {"box": SIMPLE_HEAD, "show_edge": False, "pad_edge": False, "padding": (0, 1, 0, 0)}
    for table in guard_tables.all_tables(result):
        shown = table.narrow().printed(left=1, whole=[0], title=table.caption, **style)
        shown.title_justify = "left"
        console.print(shown)
    for line in _lines(result):
        console.print(printable(line), highlight=False, markup=False, soft_wrap=True)


def _lines(result: GuardResult) -> list[str]:
    pairs = [] if result.pairs is None else [guard_tables.prevented_line(result.pairs)]
    return [
        CAPTION,
        *guard_tables.LINES,
        *result.notes,
        guard_tables.failure_line(result),
        guard_tables.method_line(result),
        *pairs,
    ]


def _page(result: GuardResult, plot: Path) -> str:
    tables = [
        blocks.Section(one.caption, [blocks.Rows(one)]) for one in guard_tables.all_tables(result)
    ]
    data = plot.read_bytes()
    caption = "Scores of nominal windows and of windows 1 s before a failure in weather and light"
    sections = [
        blocks.Section("Guard", [blocks.Text(one) for one in _lines(result)]),
        *tables,
        blocks.Section(
            "Distributions", [blocks.Images([blocks.Image(PLOT, data, caption, plot=True)])]
        ),
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
        "seed": drive.seed,
        "driven_m": drive.driven_m,
        "failures": windows.failures,
        "late": {str(lead): count for lead, count in windows.late.items()},
        "normal_windows": len(windows.normal),
    }

"""The files of a guard: guard.json, guard.html and guard.png; and its tables in the terminal."""

from dataclasses import asdict
from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.console import Console

from zoo.base.regular_file import hash_file
from zoo.base.terminal import printable
from zoo.base.whole_file import json_text, write_whole
from zoo.guard import guard_tables
from zoo.guard.conditions import DEGRADED, WEATHER
from zoo.guard.guard_drives import GuardResult, ScoredDrive
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
    for table in guard_tables.all_tables(result):
        shown = table.narrow().printed(left=1, whole=[0], title=table.caption, **style)
        shown.title_justify = "left"
        console.print(shown)
    for line in _lines(result):
        console.print(printable(line), highlight=False, markup=False, soft_wrap=True)


def _lines(result: GuardResult) -> list[str]:
    return [CAPTION, *result.notes, *guard_tables.sentences(result)]


def _page(result: GuardResult, plot: Path) -> str:
    caption = "Scores of nominal windows and of windows 1 s before a failure in weather and light"
    image = blocks.Image(PLOT, plot.read_bytes(), caption, plot=True)
    sections = [
        blocks.Section("Guard", [blocks.Text(one) for one in _lines(result)]),
        *(
            blocks.Section(one.caption, [blocks.Rows(one)])
            for one in guard_tables.all_tables(result)
        ),
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

"""The marks of a course as a table, as JSON for an autograder and as a page for a student."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from zoo.base.terminal import command_line
from zoo.base.whole_file import json_text, write_whole
from zoo.benchmark.marks import HEADLINE, Reached, mark_rows
from zoo.runs.page import Page

VERSION = 1  # of marks.json
JSON_NAME, PAGE_NAME = "marks.json", "marks.html"
WORST = 3  # drives of a missed mark's group that the page lists


def print_marks(result: Mapping[str, Any], reached: Sequence[Reached], console: Console) -> None:
    """Print a table of the marks."""
    headings = ("group", "figure", "mark", "reached", "95 % interval", "")
    table = Table(*headings, title="Marks", box=SIMPLE_HEAD)
    for row in mark_rows(result, reached):
        table.add_row(*row)
    console.print(table, highlight=False)


def write_marks(folder: Path, result: Mapping[str, Any], reached: Sequence[Reached]) -> list[Path]:
    """Write `marks.json` for an autograder and `marks.html` for the student; return the paths.

    Args:
        folder: folder of the result.
        result: contents of `result.json`.
        reached: see `reached_marks`.
    """
    passed = sum(one.passed for one in reached)
    content = {
        "version": VERSION,
        "entry": result["entry"],
        "suite": result["suite"],
        "roads": result["roads"],
        "digest": result["digest"],
        "passed": passed == len(reached),
        "marks_passed": passed,
        "marks": [
            asdict(mark) | {"reached": value, "passed": is_passed}
            for mark, value, is_passed in reached
        ],
    }
    return [
        write_whole(folder / JSON_NAME, json_text(content)),
        write_whole(folder / PAGE_NAME, _page(result, reached)),
    ]


def _page(result: Mapping[str, Any], reached: Sequence[Reached]) -> str:
    page = Page(Path(__file__).parent / "static", "marks.html", "marks.css")
    missed = list(dict.fromkeys(one.mark.group for one in reached if not one.passed))
    return page.render(
        result=result,
        count=f"{sum(one.passed for one in reached)} of {len(reached)}",
        rows=mark_rows(result, reached),
        passed=all(one.passed for one in reached),
        worst={group: _worst(result, group) for group in missed},
    )


def _worst(result: Mapping[str, Any], group: str) -> list[list[str]]:
    """Return the drives of a group with most interventions and largest errors, as texts."""
    drives = [one for one in result["drives"] if group in (one["group"], HEADLINE)]
    drives.sort(key=lambda one: (-one["figures"]["interventions"], -one["figures"]["cte_mean_m"]))
    return [
        [
            one["track"],
            ", ".join(f"{key}={_plain(value)}" for key, value in one["settings"].items()),
            f"{one['figures']['autonomy']:.1%}",
            f"{one['figures']['interventions']:.0f}",
            f"{one['figures']['cte_mean_m']:.2f}",
            _command(result["checkpoints"][one["checkpoint"]], one),
        ]
        for one in drives[:WORST]
    ]


def _command(checkpoint: Mapping[str, Any], drive: Mapping[str, Any]) -> str:
    """Return the command that films a drive; empty for a baseline, which has no checkpoint."""
    if checkpoint["sha256"] is None:
        return ""
    settings = [f"{key}={_plain(value)}" for key, value in drive["settings"].items()]
    words = [checkpoint["file"], f"track={drive['track']}", *settings, "film=true"]
    return command_line(["drivezoo", "evaluate", *words])


def _plain(value: object) -> str:
    """Return a setting as it is typed in a command: {fog: 0.4, wet: 1}."""
    return json.dumps(value).replace('"', "")

"""Pass marks of a course: figures that an entry of the benchmark must reach, and their files.

A suite's file has them by group: `marks: {like: {autonomy: 0.9, cte_mean_m: 0.8}}`. The group
`headline` has the autonomy of the whole suite. A figure that is better when it is lower, such as
`cte_mean_m`, must not be above its mark.
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

from zoo.base.errors import InputError
from zoo.base.nearest import hint
from zoo.base.terminal import command_line
from zoo.base.whole_file import json_text, write_whole
from zoo.runs.page import Page
from zoo.runs.table import Table

VERSION = 1  # of marks.json
JSON_NAME, PAGE_NAME = "marks.json", "marks.html"
WORST = 3  # drives of a missed mark's group that the page lists

HEADLINE = "headline"  # the group of the whole suite's figure, which is an autonomy
# Heading, format and whether higher is better.
FIGURES = {
    "autonomy": ("autonomy", "{:.1%}", True),
    "without_intervention": ("drives without intervention", "{:.1%}", True),
    "m_per_intervention": ("metres per intervention", "{:,.0f}", True),
    "cte_mean_m": ("mean error, m", "{:.2f}", False),
    "steering_per_s": ("steering change, 1/s", "{:.2f}", False),
}
SHARES = ("autonomy", "without_intervention")


@dataclass(frozen=True)
class Mark:
    """A figure that an entry must reach.

    Attributes:
        group: group of the suite, or `headline`.
        figure: name of the figure, one of `FIGURES`.
        value: smallest value that passes; the largest one where lower is better.
    """

    group: str
    figure: str
    value: float

    @property
    def heading(self) -> str:
        """Return the figure's name and unit in words."""
        return FIGURES[self.figure][0]

    @property
    def higher(self) -> bool:
        """Return whether a higher figure is better."""
        return FIGURES[self.figure][2]

    @property
    def required(self) -> str:
        """Return the mark in words."""
        return f"{'at least' if self.higher else 'at most'} {self.text(self.value)}"

    def passes(self, reached: float | None) -> bool:
        """Return whether a figure reaches the mark; an unknown figure does not."""
        if reached is None:
            return False
        return reached >= self.value if self.higher else reached <= self.value

    def text(self, value: float | None) -> str:
        """Return a value of the figure as text."""
        if value is None:
            return "unknown"
        if math.isinf(value):
            return "no intervention"
        return FIGURES[self.figure][1].format(value).replace(".0%", "%")


class Reached(NamedTuple):
    """A mark, the figure that an entry reached, and whether it passed.

    `reached` is None for an unknown figure, and infinite for the metres per intervention of drives
    without an intervention.
    """

    mark: Mark
    reached: float | None
    passed: bool


def read_marks(content: object, groups: Sequence[str], place: Path | str) -> list[Mark]:
    """Return the marks of a suite's file.

    Args:
        content: value of the key `marks`.
        groups: names of the suite's groups.
        place: file that error messages name.

    Raises:
        InputError: a group, figure or value is wrong.
    """
    if not isinstance(content, Mapping) or not content:
        raise InputError(
            f"{place}: marks: must be groups with figures: {{like: {{autonomy: 0.9}}}}"
        )
    known = [*groups, HEADLINE]
    marks = []
    for group, figures in content.items():
        if group not in known:
            raise InputError(f"{place}: marks.{group}: no such group; {hint(str(group), known)}")
        usable = list(FIGURES) if group != HEADLINE else ["autonomy"]
        if not isinstance(figures, Mapping) or not figures:
            raise InputError(f"{place}: marks.{group}: must be figures: {{autonomy: 0.9}}")
        for figure, value in figures.items():
            if figure not in usable:
                raise InputError(
                    f"{place}: marks.{group}.{figure}: no such figure; {hint(str(figure), usable)}"
                )
            most = 1.0 if figure in SHARES else 1e9
            is_number = isinstance(value, int | float) and not isinstance(value, bool)
            if not is_number or not 0 <= value <= most:
                kind = "share in 0..1, such as 0.9" if figure in SHARES else "number of 0 or more"
                raise InputError(f"{place}: marks.{group}.{figure}: {value}; must be a {kind}")
            marks.append(Mark(str(group), str(figure), float(value)))
    return marks


def reached_marks(result: Mapping[str, Any], marks: Sequence[Mark]) -> list[Reached]:
    """Return what an entry reached for each mark.

    The figure itself is compared with the mark, not a bound of its interval.

    Args:
        result: contents of `result.json`.
        marks: marks of the same suite.
    """
    found = []
    for mark in marks:
        figure = _figure(result, mark)
        reached = figure["value"]
        # Drives without an intervention have a lower bound only.
        if reached is None and mark.figure == "m_per_intervention" and figure["low"] is not None:
            reached = math.inf
        found.append(Reached(mark, reached, mark.passes(reached)))
    return found


def missed_line(reached: Sequence[Reached]) -> str:
    """Return one line that names the missed marks; empty if all are reached."""
    missed = [one for one in reached if not one.passed]
    if not missed:
        return ""
    texts = [
        f"{one.mark.group}: {one.mark.heading} is {one.mark.text(one.reached)}, must be "
        f"{one.mark.required}"
        for one in missed
    ]
    return f"{len(missed)} of {len(reached)} marks missed: {'; '.join(texts)}"


def marks_table(result: Mapping[str, Any], reached: Sequence[Reached]) -> Table:
    """Return a row for each mark: what was reached, with its 95 % interval."""
    rows = [
        [
            "whole suite" if mark.group == HEADLINE else mark.group,
            mark.heading,
            mark.required,
            mark.text(value),
            _interval(mark, _figure(result, mark)),
            "passed" if is_passed else "missed",
        ]
        for mark, value, is_passed in reached
    ]
    return Table.of(["group", "figure", "mark", "reached", "95 % interval", ""], rows)


def _figure(result: Mapping[str, Any], mark: Mark) -> Mapping[str, Any]:
    if mark.group == HEADLINE:
        return result["headline"]
    return result["groups"][mark.group][mark.figure]


def _interval(mark: Mark, figure: Mapping[str, Any]) -> str:
    low, high = figure["low"], figure["high"]
    if low is None:
        return ""
    return f"{mark.text(low)} or more" if high is None else f"{mark.text(low)} to {mark.text(high)}"


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
    count = f"{passed} of {len(reached)} marks reached"
    missed = list(dict.fromkeys(one.mark.group for one in reached if not one.passed))
    page = Page(Path(__file__).with_name("static") / "marks.html").render(
        title=f"{result['entry']}, suite {result['suite']}: {count}",
        result=result,
        count=count,
        marks=marks_table(result, reached),
        passed=not missed,
        worst={group: _worst(result, group) for group in missed},
    )
    return [
        write_whole(folder / JSON_NAME, json_text(content)),
        write_whole(folder / PAGE_NAME, page),
    ]


def _worst(result: Mapping[str, Any], group: str) -> tuple[Table, str]:
    """Return a group's drives with most interventions and largest errors, and how to film one."""
    drives = [one for one in result["drives"] if group in (one["group"], HEADLINE)]
    drives.sort(key=lambda one: (-one["figures"]["interventions"], -one["figures"]["cte_mean_m"]))
    headings = ["road", "settings", "autonomy", "interventions", "mean error, m"]
    rows = [
        [
            one["track"],
            ", ".join(_typed(one["settings"])) or "-",
            f"{one['figures']['autonomy']:.1%}",
            f"{one['figures']['interventions']:.0f}",
            f"{one['figures']['cte_mean_m']:.2f}",
        ]
        for one in drives[:WORST]
    ]
    command = _command(result["checkpoints"][drives[0]["checkpoint"]], drives[0])
    return Table.of(headings, rows), command


def _command(checkpoint: Mapping[str, Any], drive: Mapping[str, Any]) -> str:
    """Return the command that films a drive; empty for a baseline, which has no checkpoint."""
    if checkpoint["sha256"] is None:
        return ""
    typed = _typed(drive["settings"])
    words = [checkpoint["file"], f"track={drive['track']}", *typed, "film=true"]
    return command_line(["drivezoo", "evaluate", *words])


def _typed(settings: Mapping[str, object]) -> list[str]:
    """Return settings as they are typed in a command: weather={fog: 0.4, wet: 1}."""
    return [f"{key}={json.dumps(value)}".replace('"', "") for key, value in settings.items()]

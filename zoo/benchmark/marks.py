"""Pass marks of a course: figures that an entry of the benchmark must reach, and their files.

A suite's file has them by group: `marks: {like: {autonomy: 0.9, cte_mean_m: 0.8}}`. The group
`all but laps` has the figures of the whole suite. A figure that is better when it is lower, such as
`cte_mean_m`, must not be above its mark.
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from zoo.base.terminal import command_line
from zoo.base.whole_file import json_text, write_whole
from zoo.benchmark.result import BenchmarkResult, DriveRecord, Interval
from zoo.benchmark.suite import Marks
from zoo.benchmark.summary import FIGURES, drives_of
from zoo.drives.drive_log import read_drive
from zoo.drives.metrics import DRIVES, METRICS
from zoo.report.blocks import Image
from zoo.report.drive_section import PLOTS, worst_moment
from zoo.runs.page import Page
from zoo.runs.table import Table, with_interval

VERSION = 1  # of marks.json
FAILURES = "failures"  # folder of the repeated worst drives
WORST = 3  # drives of a missed mark's group that the page lists
DRIVE_FIGURES = ("autonomy", "interventions", "cte_mean_m", "steering_per_s")


@dataclass(frozen=True)
class Reached:
    """A mark, and what an entry reached.

    Attributes:
        group: group of the suite, or `all but laps`.
        figure: name of the figure, one of `FIGURES`.
        value: smallest value that passes; the largest one where lower is better.
        interval: what was reached, with its 95 % interval.
    """

    group: str
    figure: str
    value: float
    interval: Interval

    @property
    def reached(self) -> float | None:
        """Return the figure; None if unknown, infinite for metres without an intervention."""
        # Drives without an intervention have a lower bound only.
        endless = self.figure == "m_per_intervention" and self.interval.low is not None
        return math.inf if self.interval.value is None and endless else self.interval.value

    @property
    def passed(self) -> bool:
        """Return whether the figure itself, not a bound of its interval, reaches the mark."""
        sign = 1 if FIGURES[self.figure].higher else -1
        return self.reached is not None and sign * self.reached >= sign * self.value

    @property
    def texts(self) -> tuple[str, str, str]:
        """Return what is marked, the mark, and what was reached with its interval."""
        shown = FIGURES[self.figure]
        required = shown.form.format(shown.factor * self.value)
        bound = "at least" if shown.higher else "at most"
        reached = with_interval(self.interval, shown.form, shown.factor)
        return shown.heading, f"{bound} {required}", "unknown" if reached == "-" else reached


def reached_marks(result: BenchmarkResult, marks: Mapping[str, Marks]) -> list[Reached]:
    """Return what an entry reached for each mark of the same suite."""
    return [
        Reached(group, figure, value, result.groups[group][figure])
        for group, own in marks.items()
        for figure, value in own.model_dump(exclude_unset=True).items()
    ]


def missed_line(reached: Sequence[Reached]) -> str:
    """Return one line that names the missed marks; empty if all are reached."""
    missed = []
    for mark in reached:
        if not mark.passed:
            figure, required, value = mark.texts
            missed.append(f"{mark.group}: {figure} is {value}, must be {required}")
    return f"{len(missed)} of {len(reached)} marks missed: {'; '.join(missed)}" if missed else ""


def marks_table(reached: Sequence[Reached]) -> Table:
    """Return a row for each mark: what was reached, with its 95 % interval."""
    rows = [[mark.group, *mark.texts, "passed" if mark.passed else "missed"] for mark in reached]
    return Table.of(["group", "figure", "mark", "reached (95 % interval)", ""], rows)


def write_marks(folder: Path, result: BenchmarkResult, reached: Sequence[Reached]) -> list[Path]:
    """Write `marks.json` for an autograder and `marks.html` for the student; return the paths."""
    passed = sum(mark.passed for mark in reached)
    content = {
        "version": VERSION,
        **result.model_dump(include={"entry", "suite", "roads", "digest"}),
        "passed": passed == len(reached),
        "marks_passed": passed,
        "marks": [
            {key: getattr(mark, key) for key in ("group", "figure", "value", "reached", "passed")}
            for mark in reached
        ],
    }
    count = f"{passed} of {len(reached)} marks reached"
    template = Path(__file__).with_name("static") / "marks.html"
    page = Page(template, sources="img-src data:; ").render(
        title=f"{result.entry}, suite {result.suite}: {count}",
        result=result,
        count=count,
        marks=marks_table(reached),
        passed=passed == len(reached),
        worst={
            mark.group: (*_worst(result, mark.group), _images(folder, mark.group))
            for mark in reached
            if not mark.passed
        },
    )
    return [
        write_whole(folder / "marks.json", json_text(content)),
        write_whole(folder / "marks.html", page),
    ]


def drives_table(drives: Sequence[DriveRecord]) -> Table:
    """Return a row for each drive of a result."""
    shown = {name: METRICS[name].row(DRIVES) for name in DRIVE_FIGURES}
    rows = [
        [
            drive.group,
            drive.track,
            ", ".join(typed_settings(drive)) or "-",
            str(drive.checkpoint + 1),
            *(form.format(drive.figures[name]) for name, (_, form) in shown.items()),
            drive.digest,
        ]
        for drive in drives
    ]
    headings = [heading for heading, _ in shown.values()]
    return Table.of(["group", "road", "settings", "checkpoint", *headings, "digest"], rows)


def typed_settings(drive: DriveRecord) -> list[str]:
    """Return a drive's settings as they are typed in a command: weather={fog: 0.4, wet: 1}."""
    return [f"{key}={json.dumps(value)}".replace('"', "") for key, value in drive.settings.items()]


def failures(result: BenchmarkResult, reached: Sequence[Reached]) -> dict[str, int]:
    """Return by group with a missed mark the number of its worst drive, if one intervened."""
    worst = {mark.group: _worst_first(result, mark.group)[0] for mark in reached if not mark.passed}
    return {
        group: next(number for number, one in enumerate(result.drives) if one is drive)
        for group, drive in worst.items()
        if drive.figures["interventions"]
    }


def _worst_first(result: BenchmarkResult, group: str) -> list[DriveRecord]:
    drives = drives_of(result.drives, group)
    return sorted(
        drives, key=lambda one: (-one.figures["interventions"], -one.figures["cte_mean_m"])
    )


def _images(folder: Path, group: str) -> list[Image]:
    """Return the worst moment of a group's worst drive, and its path; none if it is not there."""
    own = folder / FAILURES / group.replace(" ", "_")
    if not own.is_dir():
        return []
    moment, path = worst_moment(read_drive(own)), own / "track.png"
    plot = [Image(path.name, path.read_bytes(), PLOTS["track"])] if path.is_file() else []
    return [*([moment] if moment else []), *plot]


def _worst(result: BenchmarkResult, group: str) -> tuple[Table, str]:
    """Return a group's drives with most interventions and largest errors, and how to film one."""
    drives = _worst_first(result, group)
    first, checkpoint = drives[0], result.checkpoints[drives[0].checkpoint]
    words = [checkpoint.file, f"track={first.track}", *typed_settings(first), "film=true"]
    command = command_line(["drivezoo", "evaluate", *words]) if checkpoint.sha256 else ""
    return drives_table(drives[:WORST]), command

"""Pass marks of a course: figures that an entry of the benchmark must reach, and their files.

A suite's file has them by group: `marks: {like: {autonomy: 0.9, cte_mean_m: 0.8}}`. The group
`all but laps` has the figures of the whole suite. A figure that is better when it is lower, such as
`cte_mean_m`, must not be above its mark.
"""

import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from zoo.base.terminal import command_line
from zoo.base.whole_file import json_text, write_whole
from zoo.driving.metrics import DRIVES, METRICS
from zoo.results.result import NAME, BenchmarkResult, DriveRecord, Interval, code_name
from zoo.results.suite import Marks, Suite, road_of
from zoo.results.summary import FIGURES, drives_of
from zoo.runs.result_table import Table, with_interval
from zoo.scoring.blocks import Block, Box, Bullets, Code, Rows, Section, Text, to_html
from zoo.scoring.drive_section import failure

FAILURES = "failures"  # folder of the repeated worst drives
VERSION = 1  # of marks.json
KEYS = ("group", "figure", "value", "reached", "passed", "status")  # of a mark there
PASSED, OPEN, MISSED = "passed", "open", "missed"
DRIVE_MORE = "open: its interval holds the mark; drive more roads"
TITLES = {
    PASSED: ("passed", "Passed"),
    OPEN: ("almost", "Open: more roads would tell"),
    MISSED: ("missed", "Not passed"),
}
MEANING = (
    "The figure itself is compared with the mark. Its 95 % interval shows how much it would change "
    "on other roads of the same kind. A mark that it does not reach is open, not missed, where the "
    "interval holds the mark: more roads would tell."
)
WORST = 3  # drives of a group below its mark that the page lists
DRIVE_FIGURES = ("autonomy", "interventions", "cte_mean_m", "steering_per_s")


@dataclass(frozen=True)
class Reached:
    """A mark, and what an entry reached.

    Attributes:
        group: group of the suite, or `all but laps`.
        figure: name of the figure, one of `FIGURES`.
        value: smallest value that passes; the largest one where lower is better.
        interval: what was reached, with its 95 % interval.
        is_clean: whether the group was driven without an intervention.
    """

    group: str
    figure: str
    value: float
    interval: Interval
    is_clean: bool

    @property
    def reached(self) -> float | None:
        """Return the figure; None if unknown, infinite for metres without an intervention."""
        endless = self.figure == "m_per_intervention" and self.is_clean
        return math.inf if endless else self.interval.value

    @property
    def passed(self) -> bool:
        """Return whether the figure itself, not a bound of its interval, reaches the mark."""
        return self.reached is not None and self._reaches(self.reached)

    @property
    def status(self) -> str:
        """Return passed, missed, or open where the interval holds an unreached mark."""
        if self.passed:
            return PASSED
        best = self.interval.high if FIGURES[self.figure].higher else self.interval.low
        return OPEN if best is not None and self._reaches(best) else MISSED

    def _reaches(self, figure: float) -> bool:
        short = self.value - figure if FIGURES[self.figure].higher else figure - self.value
        return round(short, 9) <= 0  # 9 clean drives of 20 are 0.44999999999999996

    @property
    def texts(self) -> tuple[str, str, str]:
        """Return what is marked, the mark, and what was reached with its interval."""
        shown = FIGURES[self.figure]
        required = shown.form.format(shown.factor * self.value)
        bound = "at least" if shown.higher else "at most"
        alike = shown.form.format(shown.factor * (self.reached or 0)) == required
        # Rounded, a missed one would seem to pass.
        form = "{:.5g}" if alike and not self.passed else shown.form
        unknown = "none" if self.is_clean else "unknown"  # few roads have no bound
        reached = with_interval(self.interval, form, shown.factor)
        return shown.heading, f"{bound} {required}", unknown if reached == "-" else reached


def reached_marks(result: BenchmarkResult, marks: Mapping[str, Marks]) -> list[Reached]:
    """Return what an entry reached for each mark of the same suite."""
    return [
        Reached(group, figure, value, figures[figure], figures["interventions_per_km"].value == 0)
        for group, limits in marks.items()
        for figures in [result.groups[group]]
        for figure, value in limits.model_dump(exclude_unset=True).items()
    ]


def missed_line(reached: Sequence[Reached]) -> str:
    """Return one line that names the marks that are missed or open; empty if all are reached."""
    missed = []
    for mark in reached:
        if not mark.passed:
            figure, required, value = mark.texts
            remedy = f" ({DRIVE_MORE})" if mark.status == OPEN else ""
            missed.append(f"{mark.group}: {figure} is {value}, must be {required}{remedy}")
    counts = f"{len(missed)} of {len(reached)} marks not reached"
    return f"{counts}: {'; '.join(missed)}" if missed else ""


def verdict(reached: Sequence[Reached]) -> str:
    """Return passed if all marks are reached, missed if one is missed, open otherwise."""
    return max((mark.status for mark in reached), key=[PASSED, OPEN, MISSED].index, default=PASSED)


def marks_table(reached: Sequence[Reached]) -> Table:
    """Return a row for each mark: what was reached, with its 95 % interval."""
    rows = [[mark.group, *mark.texts, mark.status] for mark in reached]
    return Table.of(["group", "figure", "mark", "reached (95 % interval)", ""], rows)


def verify_words(path: Path, suite: str) -> list[str]:
    """Return the command that repeats drives of a result; it names a suite of the user's."""
    named = [f"suite={suite}"] if suite.endswith((".yaml", ".yml")) else []
    return ["benchmark", "verify", str(path), *named]


def write_marks(
    folder: Path, result: BenchmarkResult, reached: Sequence[Reached], suite: Suite, named: str
) -> list[Path]:
    """Write `marks.json` for an autograder and `marks.html` for the student; return the paths.

    Args:
        folder: folder of the result.
        result: drives of the suite.
        reached: marks of the suite.
        suite: suite that was driven.
        named: suite as the user named it.
    """
    content = {
        "version": VERSION,
        **result.model_dump(include={"entry", "suite", "roads", "digest"}),
        "passed": verdict(reached) == PASSED,
        "marks_passed": sum(mark.passed for mark in reached),
        "marks": [{key: getattr(mark, key) for key in KEYS} for mark in reached],
    }
    worst = [
        Section(f"Worst drives: {group}", _worst(folder, result, group, suite))
        for group in _missed_groups(reached)
    ]
    facts = [
        f"checkpoint {checkpoint.file}, SHA-256 {checkpoint.sha256 or '-'}"
        for checkpoint in result.checkpoints
    ]
    facts += [f"roads {result.roads}", f"drives {result.digest}", f"code {code_name(result.code)}"]
    check = "drives some of the roads again and compares the digests."
    verify = Code(command_line(["drivezoo", *verify_words(folder / NAME, named)]))
    how = Section("How to check this result", [verify, Text(check), Bullets(facts)])
    return [
        write_whole(folder / "marks.json", json_text(content)),
        write_whole(folder / "marks.html", marks_page(result, reached, [*worst, how])),
    ]


def marks_page(result: BenchmarkResult, reached: Sequence[Reached], rest: Sequence[Section]) -> str:
    """Return the page of an entry's marks for a student, with further sections."""
    kind, title = TITLES[verdict(reached)]
    count = f"{sum(mark.passed for mark in reached)} of {len(reached)} marks reached"
    box = Box(kind, f"{title}: {count}", [f"Suite {result.suite}"], [], [])
    marks = Section("Marks", [Rows(marks_table(reached), left=3), Text(MEANING)])
    return to_html(result.entry, [Section("", [box]), marks, *rest], footer="")


def drives_table(drives: Sequence[DriveRecord]) -> Table:
    """Return a row for each drive of a result."""
    shown = {name: METRICS[name].row(DRIVES) for name in DRIVE_FIGURES}
    rows = [
        [
            drive.group,
            drive.track,
            ", ".join(typed_settings(drive.settings)) or "-",
            str(drive.checkpoint + 1),
            *(form.format(drive.figures[name]) for name, (_, form) in shown.items()),
            drive.digest,
        ]
        for drive in drives
    ]
    headings = [heading for heading, _ in shown.values()]
    return Table.of(["group", "road", "settings", "checkpoint", *headings, "digest"], rows)


def typed_settings(settings: Mapping[str, object]) -> list[str]:
    """Return a drive's settings as they are typed in a command: weather={fog: 0.4, wet: 1}."""
    return [f"{key}={json.dumps(value)}".replace('"', "") for key, value in settings.items()]


def failures(result: BenchmarkResult, reached: Sequence[Reached]) -> dict[str, int]:
    """Return by group below a mark the number of its worst drive, if it left the road."""
    worst = {group: _worst_first(result, group)[0] for group in _missed_groups(reached)}
    return {
        group: result.drives.index(drive)
        for group, drive in worst.items()
        if drive.figures["interventions"]
    }


def failure_folder(folder: Path, group: str) -> Path:
    """Return the folder of a group's worst drive in that of a result."""
    return folder / FAILURES / re.sub(r"[^\w-]", "_", group)  # a stranger's suite may name ../..


def _missed_groups(reached: Sequence[Reached]) -> list[str]:
    return list(dict.fromkeys(mark.group for mark in reached if not mark.passed))


def _worst_first(result: BenchmarkResult, group: str) -> list[DriveRecord]:
    return sorted(
        drives_of(result.drives, group),
        key=lambda drive: (drive.figures["interventions"], drive.figures["cte_mean_m"]),
        reverse=True,
    )


def _worst(folder: Path, result: BenchmarkResult, group: str, suite: Suite) -> list[Block]:
    """Return a group's worst drives, how to film the first, and its failure."""
    drives = _worst_first(result, group)
    blocks: list[Block] = [Rows(drives_table(drives[:WORST]), left=4)]
    first, checkpoint = drives[0], result.checkpoints[drives[0].checkpoint]
    scenario = next(drive.scenario for drive in suite.drives if drive.key == road_of(first))
    driven = first.settings | {"speed": scenario.speed, "quality": scenario.quality}
    words = [checkpoint.file, f"track={first.track}", *typed_settings(driven), "film=true"]
    if checkpoint.sha256:
        command = command_line(["drivezoo", "evaluate", *words])
        blocks += [Text("A film of the whole first one:"), Code(command)]
    return [*blocks, *failure(failure_folder(folder, group), with_path=True)]

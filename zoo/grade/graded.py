"""`drivezoo grade`: drives of all submissions, their marks, warnings and pages."""

import datetime
import subprocess
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path

from rich.console import Console

from datamodules.recording import Recording
from datamodules.recording_format import read_recordings
from simulator.track_names import DRAWN
from zoo.base.bounded_files import hash_file, parse_yaml
from zoo.base.child_process import end_module, start_module
from zoo.base.errors import InputError, UsageError
from zoo.base.new_folder import command_folder
from zoo.base.terminal import counted, print_line, print_written
from zoo.base.whole_file import write_whole
from zoo.benchmark.benchmarked import Benchmarked
from zoo.benchmark.marks import (
    OPEN,
    PASSED,
    Reached,
    failure_folder,
    failures,
    marks_page,
    reached_marks,
    typed_settings,
    verdict,
)
from zoo.benchmark.result import NAME, BenchmarkResult, DriveRecord
from zoo.benchmark.suite import Suite, read_suite, redraw_suite
from zoo.grade.grade_options import GradeOptions
from zoo.grade.submissions import Submission, warnings_of
from zoo.grade.submitted_network import NetworkFacts, facts_file, read_facts
from zoo.report.blocks import Block, Bullets, Heading, Rows, Section, Text, to_html
from zoo.report.drive_section import failure
from zoo.runs.table import Column, Table
from zoo.runs.table_files import Result
from zoo.training.recorded_roads import road_key

SUITE, DRIVES, PAGES = "suite.yaml", "drives", "students"
KEPT_BACK = "The roads are not named: they stay the teacher's."


@dataclass(frozen=True)
class Grade:
    """What a student reached.

    Attributes:
        submission: what was submitted.
        result: drives; None where nothing could be driven.
        reached: marks, and whether they are reached.
        warnings: what a teacher should look at.
        facts: what its network returns, and what its file tells; None where this is unknown.
    """

    submission: Submission
    result: BenchmarkResult | None = None
    reached: Sequence[Reached] = ()
    warnings: Sequence[str] = ()
    facts: NetworkFacts | None = None

    @property
    def status(self) -> str:
        """Return passed, open or missed, or `not driven`."""
        return verdict(self.reached) if self.result else "not driven"

    @property
    def submitted(self) -> str:
        """Return the time of the file's last change, local time."""
        if self.submission.file is None:
            return "-"
        seconds = self.submission.file.stat().st_mtime
        return f"{datetime.datetime.fromtimestamp(seconds):%Y-%m-%d %H:%M}"


@dataclass(frozen=True, repr=False)
class Graded(Result):
    """The marks of a class.

    Attributes:
        folder: folder with `grades.html`.
        grades: what each student reached, by name.
        written: files written, `grades.html` first.
    """

    folder: Path
    grades: Sequence[Grade]
    written: list[Path] = field(default_factory=list)

    def __repr__(self) -> str:
        counts = Counter(one.status for one in self.grades)
        return f"{counted(len(self.grades), 'submission')}: " + ", ".join(
            f"{count} {status}" for status, count in counts.most_common()
        )

    @property
    def lines(self) -> list[str]:
        """Return what a teacher should look at, a line each."""
        return [f"{one.submission.name}: {line}" for one in self.grades for line in one.warnings]

    def show(self) -> None:
        """Print what to look at, the counts, and what was written."""
        console = Console(emoji=False)
        for line in self.lines:
            print_line(console, line)
        print_line(console, repr(self))
        print_written(self.written, console=console)

    def result_table(self) -> Table:
        """Return a row for each student."""
        shown = [
            Column("student", "student", [one.submission.name for one in self.grades]),
            Column("submitted", "submitted", [one.submitted for one in self.grades]),
            Column("result", "result", [one.status for one in self.grades]),
        ]
        marks = [{(mark.group, mark.figure): mark for mark in one.reached} for one in self.grades]
        for group, figure in dict.fromkeys(key for own in marks for key in own):
            found = [own.get((group, figure)) for own in marks]
            name = f"{group}_{figure}".replace(" ", "_")
            first = next(mark for mark in found if mark)
            heading, required, _ = first.texts
            cells = [_cell(mark) if mark else "-" for mark in found]
            figures = {name: [mark.reached if mark else None for mark in found]}
            figures |= {
                f"{name}_{key}": [getattr(mark.interval, key) if mark else None for mark in found]
                for key in ("low", "high")
            }
            shown.append(Column(name, f"{group}: {heading}, {required}", cells, figures))
        warnings = ["; ".join(one.warnings) for one in self.grades]
        return Table([*shown, Column("to_look_at", "to look at", warnings)])


def grade_class(
    submissions: Sequence[Submission], options: GradeOptions, console: Console
) -> Graded:
    """Drive all submissions, and write the marks.

    Raises:
        UsageError: `roads` is given without `seed`.
        InputError: the suite has no marks, or a recording or a folder cannot be read.
    """
    if options.roads > 1 and options.seed is None:
        raise UsageError(f"roads={options.roads}: are drawn; name seed=NUMBER, too")
    options.check_files()
    text = redraw_suite(options.suite, options.seed, options.roads)
    if "marks" not in parse_yaml(text):
        raise InputError(f"suite={options.suite}: has no marks; add them, see conf/suite")
    recording = read_recordings(options.recording) if options.recording else None
    with command_folder(options.out, "grades", resumed_by=SUITE) as out:
        path = out / SUITE
        if path.is_file() and path.read_text(encoding="utf-8") != text:
            raise InputError(f"{path}: other roads were begun there; name another out=")
        write_whole(path, text)
        suite = read_suite(str(path))
        with ThreadPoolExecutor(options.jobs) as pool:
            grades = list(
                pool.map(lambda one: _grade(one, out, suite, options, console), submissions)
            )
        grades = _with_warnings(grades, suite, recording)
        for one in grades:
            if one.result is not None:
                _write_page(out, one, options.seed is not None)
        graded = Graded(out, grades)
        page = to_html("Marks of the class", _overview(graded, suite), footer="")
        graded.written.append(write_whole(out / "grades.html", page))
        graded.written.append(graded.write_table(out / "grades.csv"))
        graded.written.extend(options.write_files(graded))
        return graded


def _grade(
    submission: Submission, out: Path, suite: Suite, options: GradeOptions, console: Console
) -> Grade:
    """Drive a submission in a process of its own, unless it has been driven, and read its marks."""
    try:
        if submission.file is None:
            raise InputError(submission.problem)
        folder = _drives(out, submission)
        if not (folder / NAME).is_file():
            _drive(folder, submission, out / SUITE, options.minutes)
        result = Benchmarked.read(folder).result
    except InputError as error:
        return Grade(submission, warnings=[f"not driven: {error}"])
    marks = reached_marks(result, suite.marks)
    grade = Grade(submission, result, marks, facts=read_facts(facts_file(folder)))
    print_line(console, f"{submission.name}: {grade.status}")
    return grade


def _drives(out: Path, submission: Submission) -> Path:
    """Return the folder of a file's drives; a changed file is another submission."""
    assert submission.file is not None
    return out / DRIVES / f"{submission.name}-{hash_file(submission.file)[:8]}"


def _drive(folder: Path, submission: Submission, suite: Path, minutes: float) -> None:
    """Drive a submission as `drivezoo benchmark` does; its output and facts go to files.

    Raises:
        InputError: it took too long, or could not be driven.
    """
    words = [str(submission.file), f"suite={suite}", f"entry={submission.name}", f"out={folder}"]
    folder.parent.mkdir(exist_ok=True)
    log = folder.with_name(f"{folder.name}.txt")
    with log.open("w", encoding="utf-8") as file:
        process = start_module(
            "zoo.grade.submitted_network",
            str(facts_file(folder)),
            *words,
            "workers=1",
            stdout=file,
            stderr=subprocess.STDOUT,
        )
        try:
            process.wait(minutes * 60)
        except subprocess.TimeoutExpired:
            raise InputError(f"not driven within {minutes:g} min; give it more minutes=") from None
        finally:
            end_module(process)
    if not (folder / NAME).is_file():
        lines = log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
        raise InputError(
            lines[-1].rpartition("drivezoo benchmark: ")[2]
            if lines
            else f"ended with {process.returncode}"
        )


def _with_warnings(
    grades: Sequence[Grade], suite: Suite, recording: Recording | None
) -> list[Grade]:
    """Return the grades with what a teacher should look at."""
    roads = {road_key(track): track for track in {one.track for one in suite.drives}}
    found = []
    for one in grades:
        if one.result is None:
            found.append(one)
            continue
        driver = one.result.checkpoints[0]
        warnings = warnings_of(one.submission, driver, one.facts, roads, recording)
        same = [
            other.submission.name
            for other in grades
            if other is not one and one.facts and other.facts and one.facts.equals(other.facts)
        ]
        if same:
            warnings.append(f"is the same network as {', '.join(same)}")
        found.append(replace(one, warnings=warnings))
    return found


def _overview(graded: Graded, suite: Suite) -> list[Section]:
    roads = len({one.track for one in suite.drives})
    drives = counted(len(suite.drives), "drive")
    line = f"Suite {suite.name}, {drives} on {counted(roads, 'road')}. {graded!r}."
    table = graded.result_table()
    shown = replace(table, columns=table.columns[:-1])  # the last one's texts are long
    sections = [Section("", [Text(line), Rows(shown, left=3)])]
    if lines := graded.lines:
        sections.append(Section("To look at", [Bullets(lines)]))
    return sections


def _write_page(out: Path, grade: Grade, is_secret: bool) -> None:
    """Write the page of a student, with films of where the network left the road."""
    assert grade.result is not None
    path = out / PAGES / f"{grade.submission.name}.html"
    if path.is_file() and grade.result.digest in path.read_text(encoding="utf-8"):
        return  # of an earlier command
    folder = _drives(out, grade.submission)
    blocks: list[Block] = []
    for group, number in failures(grade.result, grade.reached).items():
        blocks += [Heading(_named(grade.result.drives[number], is_secret))]
        blocks += failure(failure_folder(folder, group), with_path=not is_secret)
    sections = [Section("Where it left the road", blocks)] if blocks else []
    facts = [f"SHA-256 of the file: {grade.result.checkpoints[0].sha256}"]
    facts.append(f"Digest of the drives: {grade.result.digest}")
    secret = [Text(KEPT_BACK)] if is_secret else []
    sections.append(Section("What was driven", [Bullets(facts), *secret]))
    path.parent.mkdir(exist_ok=True)
    write_whole(path, marks_page(grade.result, grade.reached, sections))


def _named(drive: DriveRecord, is_secret: bool) -> str:
    """Return the heading of a drive; a drawn road is named by its family alone."""
    family = DRAWN.fullmatch(drive.track)
    road = f"a road of {family[1]}" if is_secret and family else drive.track
    return ", ".join([f"{drive.group}: {road}", *typed_settings(drive)])


def _cell(mark: Reached) -> str:
    """Return a mark in a narrow cell: its status where it is not passed, its interval if open."""
    text = mark.texts[2]
    short = text.partition(" (")[0]
    return {OPEN: f"{text}, {OPEN}", PASSED: short}.get(mark.status, f"{short}, {mark.status}")

"""`drivezoo grade`: drives of all submissions, their marks, warnings and pages."""

import secrets
import subprocess
import threading
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

from rich.console import Console

from datamodules.recording import Recording
from datamodules.recording_format import read_recordings
from zoo.base.bounded_files import hash_file, read_text
from zoo.base.child_process import end_module, start_module
from zoo.base.console_progress import progress_bar
from zoo.base.errors import InputError, StoppedError, UsageError
from zoo.base.new_folder import command_folder
from zoo.base.terminal import counted, print_line, print_written, printable
from zoo.base.whole_file import write_whole
from zoo.checkpoints.checkpoint_path import PACKAGED, packaged_names
from zoo.extras.teaching.grade_options import GradeOptions
from zoo.extras.teaching.redrawn_suite import redraw_suite
from zoo.extras.teaching.submissions import Submission, warnings_of
from zoo.extras.teaching.submitted_network import (
    NetworkFacts,
    facts_file,
    network_facts,
    read_facts,
)
from zoo.results.benchmarked import Benchmarked, nan_line
from zoo.results.checked_result import check_suite
from zoo.results.marks import (
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
from zoo.results.result import NAME, BenchmarkResult, DriveRecord, code_name
from zoo.results.suite import Suite, read_suite
from zoo.runs.code_fingerprint import code_fingerprint
from zoo.runs.record_fields import MOST_WHOLE
from zoo.runs.result_table import Column, Table, number_column
from zoo.runs.table_files import Result
from zoo.scoring.blocks import Block, Bullets, Heading, Rows, Section, Text, to_html
from zoo.scoring.drive_section import failure
from zoo.simulator.track_names import DRAWN
from zoo.training.recorded_roads import road_key

SUITE, SEED, DRIVES, PAGES = "suite.yaml", "seed.txt", "drives", "students"
LOOK_S = 0.2  # seconds between two looks at a process
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
        """Return passed, open or missed, `not driven`, or `waiting` before the drive."""
        if self.result:
            return verdict(self.reached)
        return "not driven" if self.warnings else "waiting"

    @property
    def share(self) -> float | None:
        """Return the share of its marks that are passed; None where nothing was driven."""
        if not self.reached:
            return None
        return sum(mark.passed for mark in self.reached) / len(self.reached)


@dataclass(frozen=True, repr=False)
class Graded(Result):
    """The marks of a class.

    Attributes:
        folder: folder with `grades.html`.
        grades: what each student reached, by name.
        most_points: points of a student who passes all marks.
        written: files written, `grades.html` first.
    """

    folder: Path
    grades: list[Grade]
    most_points: float
    written: list[Path] = field(default_factory=list)

    def __repr__(self) -> str:
        counts = Counter(grade.status for grade in self.grades)
        return f"{counted(len(self.grades), 'submission')}: " + ", ".join(
            f"{count} {status}" for status, count in counts.most_common()
        )

    @property
    def lines(self) -> list[str]:
        """Return what a teacher should look at, a line each."""
        return [f"{row.submission.name}: {line}" for row in self.grades for line in row.warnings]

    @property
    def points(self) -> list[float | None]:
        """Return the points of each student; None where nothing was driven."""
        shares = (grade.share for grade in self.grades)
        return [None if share is None else round(share * self.most_points, 2) for share in shares]

    def show(self) -> None:
        """Print what to look at, the counts, and what was written."""
        console = Console(emoji=False)
        for line in self.lines:
            print_line(console, printable(line))
        print_line(console, repr(self))
        print_written(self.written, console=console)

    def result_table(self) -> Table:
        """Return a row for each student."""
        shown = [
            Column("student", "student", [grade.submission.name for grade in self.grades]),
            Column("submitted", "submitted", [grade.submission.submitted for grade in self.grades]),
            Column("result", "result", [grade.status for grade in self.grades]),
            number_column("points", f"points of {self.most_points:g}", self.points, "{:g}"),
        ]
        if any(numbers := [grade.submission.number for grade in self.grades]):
            shown.insert(1, Column("number", "number", numbers))
        marks = [
            {(mark.group, mark.figure): mark for mark in grade.reached} for grade in self.grades
        ]
        for group, figure in dict.fromkeys(key for by_key in marks for key in by_key):
            column = [by_key.get((group, figure)) for by_key in marks]
            name = f"{group}_{figure}".replace(" ", "_")
            first = next(mark for mark in column if mark)
            heading, required, _ = first.texts
            cells = [_cell(mark) if mark else "-" for mark in column]
            figures = {name: [mark.reached if mark else None for mark in column]}
            figures |= {
                f"{name}_{key}": [getattr(mark.interval, key) if mark else None for mark in column]
                for key in ("low", "high")
            }
            shown.append(Column(name, f"{group}: {heading}, {required}", cells, figures))
        warnings = ["; ".join(grade.warnings) for grade in self.grades]
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
    options.check_files(inputs=[options.recording] if options.recording else [])
    if not read_suite(options.suite).marks:
        raise InputError(f"suite={options.suite}: has no marks; add them, see conf/suite")
    recording = read_recordings(options.recording) if options.recording else None
    with command_folder(options.out, "grades", resumed_by=SUITE) as out:
        path = out / SUITE
        seed = options.seed if options.seed != "random" else _kept_seed(out, console)
        text = redraw_suite(options.suite, seed, options.roads)
        if path.is_file() and path.read_text(encoding="utf-8") != text:
            raise InputError(f"{path}: other roads were begun there; name another out=")
        write_whole(path, text)
        suite = read_suite(str(path))
        packaged: dict[str, NetworkFacts | None] = {
            f"{name}, which comes with drivezoo": network_facts(PACKAGED / f"{name}.ckpt")
            for name in packaged_names()
        }
        grades = [Grade(submission) for submission in submissions]
        likeness: dict[frozenset[str], str] = {}
        pool = ThreadPoolExecutor(options.jobs)
        with pool, progress_bar("grading", console) as report:
            stop = threading.Event()
            settings = out, suite, options, recording, stop
            jobs = {pool.submit(_grade, entry, *settings): n for n, entry in enumerate(submissions)}
            try:
                for count, job in enumerate(as_completed(jobs), 1):
                    grades[jobs[job]] = grade = job.result()
                    print_line(console, printable(f"{grade.submission.name}: {grade.status}"))
                    graded = _compared(Graded(out, grades, options.points), packaged, likeness)
                    graded.written.extend(_write_marks(graded, suite))
                    report(count / len(jobs))
            except KeyboardInterrupt:
                raise StoppedError(f"stopped; the same command with out={out} resumes") from None
            finally:
                stop.set()  # Ctrl-C does not reach the processes on Windows
                pool.shutdown(wait=False, cancel_futures=True)
        graded.written.extend(options.write_files(graded))
        return graded


def _kept_seed(out: Path, console: Console) -> int:
    """Return the number that draws the roads: the folder's, or a random one, which it keeps."""
    path = out / SEED
    if not path.is_file():
        if (out / SUITE).is_file():
            raise InputError(f"{out}: was begun without seed=random; name another out=")
        write_whole(path, f"{secrets.randbelow(MOST_WHOLE)}\n")
    line = f"{path}: draws the roads; keep it secret, and resume with out={out}"
    print_line(console, printable(line))
    if not (text := read_text(path, 100).strip()).isdecimal():
        raise InputError(f"{path}: holds no number; name another out=")
    return int(text)


def _grade(
    submission: Submission,
    out: Path,
    suite: Suite,
    options: GradeOptions,
    recording: Recording | None,
    stop: threading.Event,
) -> Grade:
    """Drive a submission in a process of its own, unless it has been driven, and mark it."""
    problems: list[str] = []
    grade = Grade(submission)
    with _noted(problems, "not driven"):
        if submission.problem:
            raise InputError(submission.problem)
        folder = _drives(out, submission)
        if not (folder / NAME).is_file():
            _drive(folder, submission, out / SUITE, options.minutes, stop)
        result = Benchmarked.read(folder).result
        check_suite(result, suite, folder)  # a road's file may have changed since
        if line := nan_line(result):
            raise InputError(line)
        if result.code.get("hash") != code_fingerprint()["hash"]:
            problems.append(f"driven by other code ({code_name(result.code)}); delete {folder}")
        grade = Grade(submission, result, reached_marks(result, suite.marks))
        with _noted(problems, "not looked at"):
            grade = replace(grade, facts=read_facts(facts_file(folder)))
            roads = {road_key(track): track for track in {drive.track for drive in suite.drives}}
            facts = result.checkpoints[0], grade.facts
            problems += warnings_of(submission, *facts, roads, recording)
    with _noted(problems, "no page"):
        _write_page(out, grade, options.seed is not None, problems)
    return replace(grade, warnings=problems)


@contextmanager
def _noted(problems: list[str], what: str) -> Iterator[None]:
    """Note what goes wrong with one submission, so that the others are marked."""
    try:
        yield
    except Exception as error:  # any, of a stranger's file
        text = error if isinstance(error, InputError) else f"{type(error).__name__}: {error}"
        problems.append(f"{what}: {text}")


def _drives(out: Path, submission: Submission) -> Path:
    """Return the folder of a file's drives; a changed file is another submission."""
    assert submission.file is not None
    return out / DRIVES / f"{submission.stem}-{hash_file(submission.file)[:8]}"


def _drive(
    folder: Path, submission: Submission, suite: Path, minutes: float, stop: threading.Event
) -> None:
    """Drive a submission as `drivezoo benchmark` does; its output and facts go to files.

    Raises:
        InputError: it took too long, or could not be driven.
    """
    words = [str(submission.file), f"suite={suite}", f"entry={submission.stem}", f"out={folder}"]
    folder.parent.mkdir(exist_ok=True)
    log = folder.with_name(f"{folder.name}.txt")
    with log.open("w", encoding="utf-8") as file:
        process = start_module(
            "zoo.extras.teaching.submitted_network",
            str(facts_file(folder)),
            *words,
            "workers=1",
            stdout=file,
            stderr=subprocess.STDOUT,
        )
        try:
            last_s = time.monotonic() + 60 * minutes
            while process.poll() is None and not stop.wait(LOOK_S):
                if time.monotonic() > last_s:
                    raise InputError(f"not driven within {minutes:g} min; give it more minutes=")
        finally:
            end_module(process)
    if not (folder / NAME).is_file():
        if not 0 <= (status := process.returncode) < 256:  # the last line is of its progress
            how = f"signal {-status}" if status < 0 else f"error {status:#x}"  # of Windows
            raise InputError(f"killed by {how}, perhaps because memory ran out")
        lines = log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
        problem = lines[-1].rpartition("drivezoo benchmark: ")[2] if lines else ""
        # A student hands in what drives without further Python, and has no other file to name.
        what, for_python, _ = problem.partition("; three lines of Python drive it")
        problem = f"{what}; hand in an ONNX file or a checkpoint" if for_python else what
        what, another, _ = problem.partition("name another checkpoint")
        problem = f"{what}hand in another" if another else what
        raise InputError(problem or f"ended with {process.returncode}")


def _compared(
    graded: Graded,
    packaged: dict[str, NetworkFacts | None],
    likeness: dict[frozenset[str], str],
) -> Graded:
    """Return the marks with a warning for each copied network and each number of two rows.

    Args:
        graded: marks without these warnings.
        packaged: facts on the networks that come with drivezoo, by name.
        likeness: likeness of each two names that were compared before; the others are added.
    """
    facts = packaged | {grade.submission.name: grade.facts for grade in graded.grades}
    numbers = {grade.submission.name: grade.submission.number for grade in graded.grades}
    grades = []
    for grade in graded.grades:
        own, copies = grade.submission.name, []
        for name, other in facts.items():
            pair = frozenset((own, name))
            if name != own and grade.facts and other and pair not in likeness:
                likeness[pair] = grade.facts.likeness(other)
            if likeness.get(pair):
                copies.append(f"is {likeness[pair]} network as {name}")
        if (number := numbers[own]) and grade.status != "waiting":
            twice = [name for name in sorted(numbers) if numbers[name] == number and name != own]
            copies += [f"has the number {number}, as {name}; keep one" for name in twice[:1]]
        grades.append(replace(grade, warnings=[*grade.warnings, *copies]))
    return replace(graded, grades=grades)


def _write_marks(graded: Graded, suite: Suite) -> list[Path]:
    """Write what is known of the marks of the class; return the paths of the files."""
    page = to_html("Marks of the class", _overview(graded, suite), footer="")
    written = write_whole(graded.folder / "grades.html", page)
    return [written, graded.write_table(graded.folder / "grades.csv", overwrite=True)]


def _overview(graded: Graded, suite: Suite) -> list[Section]:
    roads = len({drive.track for drive in suite.drives})
    drives = counted(len(suite.drives), "drive")
    line = f"Suite {suite.name}, {drives} on {counted(roads, 'road')}. {graded!r}."
    table = graded.result_table()
    shown = replace(table, columns=table.columns[:-1])  # the last one's texts are long
    left = [column.name for column in shown.columns].index("points")
    look = [Section("To look at", [Bullets(graded.lines)])] if graded.lines else []
    return [Section("", [Text(line), Rows(shown, left=left)]), *look]


def _write_page(out: Path, grade: Grade, is_secret: bool, problems: Sequence[str]) -> None:
    """Write the page of a student, with films of where the network left the road."""
    path = out / PAGES / f"{grade.submission.stem}.html"
    path.parent.mkdir(exist_ok=True)
    if grade.result is None:
        reasons = [Section("", [Bullets(problems)])]
        write_whole(path, to_html(f"{grade.submission.name}: not driven", reasons, footer=""))
        return
    facts = [f"SHA-256 of the file: {grade.result.checkpoints[0].sha256}"]
    facts.append(f"Digest of the drives: {grade.result.digest}")
    page = path.read_text(encoding="utf-8") if path.is_file() else ""
    if all(fact in page for fact in facts):
        return  # of an earlier command
    folder = _drives(out, grade.submission)
    blocks: list[Block] = []
    for group, number in failures(grade.result, grade.reached).items():
        blocks += [Heading(_named(grade.result.drives[number], is_secret))]
        blocks += failure(failure_folder(folder, group), with_path=not is_secret)
    sections = [Section("Where it left the road", blocks)] if blocks else []
    secret = [Text(KEPT_BACK)] if is_secret else []
    sections.append(Section("What was driven", [Bullets(facts), *secret]))
    write_whole(path, marks_page(grade.result, grade.reached, sections))


def _named(drive: DriveRecord, is_secret: bool) -> str:
    """Return the heading of a drive; a drawn road is named by its family alone."""
    family = DRAWN.fullmatch(drive.track)
    road = f"a road of {Path(family[1]).stem}" if is_secret and family else drive.track
    return ", ".join([f"{drive.group}: {road}", *typed_settings(drive.settings)])


def _cell(mark: Reached) -> str:
    """Return a mark in a narrow cell: its status where it is not passed, its interval if open."""
    text = mark.texts[2]
    short = text.partition(" (")[0]
    return {OPEN: f"{text}, {OPEN}", PASSED: short}.get(mark.status, f"{short}, {mark.status}")

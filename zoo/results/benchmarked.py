"""`drivezoo benchmark`: the drives of an entry, their figures, table, plot and page."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.text import Text

from zoo.base.errors import StoppedError
from zoo.base.new_folder import command_folder
from zoo.base.terminal import counted, print_written, printable
from zoo.base.whole_file import write_whole
from zoo.checkpoints.checkpoint_path import packaged_name
from zoo.driving.drives_table import tied_line
from zoo.driving.metrics import DRIVES, METRICS
from zoo.driving.run_drives import load_kept
from zoo.results import marks
from zoo.results.benchmark_options import HUMAN, NO_CHECKPOINT, BenchmarkOptions
from zoo.results.checked_result import read_result
from zoo.results.result import (
    ANALYSIS,
    DIGESTS,
    SCORES,
    VERSION,
    BenchmarkResult,
    Driver,
    Interval,
    digest_of_drives,
    write_result,
)
from zoo.results.suite import OVERALL, read_suite
from zoo.results.suite_drives import (
    UNFINISHED,
    FinishedDrives,
    drive_again,
    drive_suite,
    find_drivers,
)
from zoo.results.summary import (
    FIGURES,
    LEVEL_FIGURES,
    drives_of,
    known_figures,
    outside_metrics,
    overall,
    summarize_drives,
)
from zoo.runs.code_fingerprint import code_fingerprint
from zoo.runs.page import Page
from zoo.runs.plots import interval_plot
from zoo.runs.result_table import Column, Table, interval_column, number_column, with_interval
from zoo.runs.table_files import Result
from zoo.scoring.evidence import other_car_line

PAGE = "benchmark.html"
SHORT = ("interventions_per_km", "without_intervention", "autonomy")
INTERVALS = (
    "95 % interval for new roads of the families and new trainings; with one training seed, for "
    "this training. Fewer than 3 roads: no interval."
)
CAPTION = f"Below or behind each figure: its {INTERVALS}"


@dataclass(frozen=True, repr=False)
class Benchmarked(Result):
    """The drives of an entry on a suite's roads.

    Attributes:
        folder: folder with `result.json`.
        result: contents of `result.json`.
        reached: marks of the suite, and whether they are reached; none if the network steered NaN.
        written: paths of the files written, `result.json` first.
        suite: suite as the user named it.
    """

    folder: Path
    result: BenchmarkResult
    reached: Sequence[marks.Reached]
    written: list[Path] = field(default_factory=list)
    suite: str = ""

    @classmethod
    def read(cls, path: str | Path) -> "Benchmarked":
        """Return the result of a file `result.json`, or of its folder; it has no marks.

        Raises:
            InputError: the file cannot be read.
        """
        path = Path(path).expanduser()
        return cls(path if path.is_dir() else path.parent, read_result(path), [])

    @property
    def overall(self) -> dict[str, Interval]:
        """Return the figures of all groups but the laps; of the laps where there are no others."""
        return overall(self.result)

    @property
    def problem(self) -> str:
        """Return what makes the benchmark fail; empty if nothing does."""
        return nan_line(self.result) or marks.missed_line(self.reached)

    def __fspath__(self) -> str:
        """Return the folder, so that commands take the result as a path."""
        return str(self.folder)

    def __repr__(self) -> str:
        name = f"{self.result.entry}, suite {self.result.suite}"
        return f"Benchmarked in {self.folder}: {name}\n  {overall_line(self.result)}"

    def show(self) -> None:
        """Print the figures, the marks that are reached, and what was written."""
        console = Console(emoji=False)
        print_result(self.result, console)
        if self.reached:
            shown = marks.marks_table(self.reached).printed(title="Marks", box=SIMPLE_HEAD)
            console.print(shown, highlight=False)
        verify = marks.verify_words([*self.written, self.folder][0], self.suite)
        by_hand = self.result.checkpoints[0].file == HUMAN  # nobody can repeat it
        print_written(self.written, [] if by_hand else verify, console)

    def result_table(self) -> Table:
        """Return a row for each group of roads."""
        return groups_table(self.result)

    def plot(self) -> Figure:
        """Return the score of each group with its 95 % interval; see `BenchmarkResult.score`."""
        score = self.result.score
        groups = {name: figures[score] for name, figures in self.result.groups.items()}
        return interval_plot(groups, f"{SCORES[score]} of {self.result.entry} (%)")


def score_entry(names: list[str], options: BenchmarkOptions, console: Console) -> Benchmarked:
    """Drive a suite with the checkpoints of an entry, and write the figures.

    Raises:
        InputError: a checkpoint or the suite cannot be used.
        StoppedError: on Ctrl-C.
    """
    # Report wrong input before processes start.
    outside = (name for name in METRICS if name not in METRICS.own())
    options.check_files(("group", "drives", *FIGURES, *LEVEL_FIGURES, *outside))
    suite = read_suite(options.suite, options.split)
    drivers = find_drivers(names, suite)
    data = {} if drivers[0].file in NO_CHECKPOINT else load_kept(drivers[0].file).data
    if line := other_car_line(data, f"the suite {suite.name}"):
        console.print(line, highlight=False, markup=False, soft_wrap=True)
    with command_folder(options.out, "benchmarks", resumed_by=UNFINISHED) as folder:
        code = code_fingerprint()  # files that are edited during the drives are not in it
        finished = FinishedDrives(folder, drivers, suite)
        if finished.drives:
            line = f"{folder}: resumes after {len(finished.drives)} finished drives"
            console.print(line, highlight=False, markup=False, soft_wrap=True)
        jobs = [(number, drive) for number in range(len(drivers)) for drive in suite.drives]
        workers = 1 if drivers[0].file == HUMAN else options.workers
        how = workers, console, finished, options.executor
        try:
            drives = drive_suite(drivers, jobs, suite.mean_steering, *how)
        except KeyboardInterrupt:
            raise StoppedError(
                f"stopped after {len(finished.drives)} of {counted(len(jobs), 'drive')}; the same "
                f"command with out={folder} resumes"
            ) from None
        result = BenchmarkResult(
            version=VERSION,
            analysis=ANALYSIS,
            suite=suite.name,
            roads=suite.roads,
            code=code,
            entry=options.entry or packaged_name(Path(drivers[0].file)) or drivers[0].model.lower(),
            checkpoints=drivers,
            drives=drives,
            **vars(summarize_drives(drives)),
            digest=digest_of_drives(drives),
            digests=DIGESTS,
            usual=suite.usual,
        )
        written = write_entry(folder, result)
        finished.path.unlink()
        reached = [] if nan_line(result) else marks.reached_marks(result, suite.marks)
        if reached:
            worst = {
                marks.failure_folder(folder, group): jobs[number]
                for group, number in marks.failures(result, reached).items()
            }
            drive_again(drivers, worst, suite.mean_steering, console)
            written += marks.write_marks(folder, result, reached, suite, options.suite)
        benchmarked = Benchmarked(folder, result, reached, written, options.suite)
        written += options.write_files(benchmarked)
        return benchmarked


def write_entry(folder: Path, result: BenchmarkResult) -> list[Path]:
    """Write `result.json` and `benchmark.html`; return their paths."""
    headings = ["number", *Driver.model_fields]
    rows = [
        [str(number), *("-" if value in (None, "") else str(value) for _, value in driver)]
        for number, driver in enumerate(result.checkpoints, 1)
    ]
    page = Page(Path(__file__).with_name("static") / PAGE).render(
        title=f"{result.entry}, suite {result.suite}",
        result=result,
        lead=overall_line(result),
        groups=groups_table(result),
        levels=levels_table(result),
        differences=difference_lines(result),
        caption=CAPTION,
        checkpoints=Table.of(headings, rows),
        drives=marks.drives_table(result.drives),
    )
    return [write_result(folder, result), write_whole(folder / PAGE, page)]


def figure_columns(rows: Sequence[Mapping[str, Interval]], group: str = "") -> list[Column]:
    """Return a column for each figure of the rows; not short if they are those of a group."""
    return [
        interval_column(
            f"{group}_{key}" if group else key,
            f"{shown.heading}, {group}" if group else shown.heading,
            [row[key] for row in rows],
            shown.form,
            shown.factor,
            key in SHORT and not group,
        )
        for key, shown in known_figures(rows).items()
    ]


def levels_table(result: BenchmarkResult) -> Table | None:
    """Return for each axis how many drives of each level were clean; None without axes."""
    counts: dict[str, dict[int, list[bool]]] = {}
    for drive in result.drives:
        if drive.level:
            counts.setdefault(drive.group, {}).setdefault(drive.level, []).append(drive.is_clean)
    if not counts:
        return None
    levels = sorted({level for count in counts.values() for level in count})
    rows = [
        [axis, *(f"{sum(row[key])} of {len(row[key])}" if key in row else "-" for key in levels)]
        for axis, row in counts.items()
    ]
    return Table.of(["clean drives", *(f"level {level}" for level in levels)], rows)


def groups_table(result: BenchmarkResult) -> Table:
    """Return a row for each group of roads."""
    groups = result.groups.values()
    counts = [len(drives_of(result.drives, name)) for name in result.groups]
    columns = [
        Column("group", "group", list(result.groups)),
        number_column("drives", "drives", counts),
    ]
    columns += figure_columns(list(groups))
    for key in outside_metrics(result.drives):  # their part may not be named here
        heading, form = METRICS[key].row(DRIVES) if key in METRICS else (key, "{:.4g}")
        columns.append(interval_column(key, heading, [group[key] for group in groups], form))
    title = f"{result.entry} on the suite {result.suite}"
    return Table(columns, f"{title}. In brackets: {INTERVALS}")


def print_result(result: BenchmarkResult, console: Console) -> None:
    """Print the main figures of each group and of all, the differences, and the digest."""
    shown = groups_table(result).short().narrow()
    cells = [replace(column, heading=printable(column.heading)) for column in shown.columns]
    title = printable(f"{result.entry}, suite {result.suite}")
    style: dict[str, Any] = {"box": SIMPLE_HEAD, "pad_edge": False}
    titled = style | {"title": Text(title), "caption": CAPTION, "caption_justify": "left"}
    console.print(Table(cells).printed(left=1, **titled))
    if levels := levels_table(result):
        console.print(levels.printed(left=1, **style), highlight=False)
    lines = [*difference_lines(result), overall_line(result)]
    lines += filter(None, [tied_line([driver.model_dump() for driver in result.checkpoints])])
    for line in (*lines, f"digest of the drives: {result.digest}"):
        console.print(printable(line), highlight=False, markup=False, soft_wrap=True)


def difference_lines(result: BenchmarkResult) -> list[str]:
    """Return a sentence for each shifted group: its difference to the clean partners."""
    lines = []
    for group, figures in result.differences.items():
        autonomy = with_interval(figures["autonomy"], "{:+.1f}", 100)
        error = with_interval(figures["cte_mean_m"], "{:+.2f}")
        text = f"autonomy, %-points: {autonomy}; mean error, m: {error}"
        few = "" if figures["autonomy"].low is not None else " (fewer than 3 roads: no interval)"
        lines.append(f"{group} minus clean drives of the same roads: {text}{few}")
    return lines


def overall_line(result: BenchmarkResult) -> str:
    """Return the figures over all roads as a sentence."""
    trained = any(driver.sha256 for driver in result.checkpoints)
    by = counted(len(result.checkpoints), "training seed") if trained else "without training"
    drives = drives_of(result.drives, OVERALL) or result.drives
    clean = sum(not drive.figures["interventions"] for drive in drives)
    rate = with_interval(overall(result)["interventions_per_km"], "{:,.2f}")
    if result.has_levels:
        share = with_interval(overall(result)[result.score], "{:.1f}", 100)
        return f"clean drives, %: {share} ({clean} of {len(drives)}); failures per km: {rate}; {by}"
    roads = len({drive.track for drive in drives})
    return (
        f"interventions per km: {rate}; drives without one: {clean} of {len(drives)}, on {roads} "
        f"roads; {by}"
    )


def nan_line(result: BenchmarkResult) -> str:
    """Return a warning if the network steered NaN in a drive; empty if it did not."""
    lost = [drive for drive in result.drives if drive.figures.get("nan_frames")]
    if not lost:
        return ""
    frames = counted(sum(int(drive.figures["nan_frames"] or 0) for drive in lost), "frame")
    return (
        f"{result.checkpoints[lost[0].checkpoint].file}: the network steered NaN in {frames}: "
        "these figures are not the network's; train again with a smaller optim.lr"
    )

"""The result of `drivezoo benchmark`: its table, plot and page, and how it is printed."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from matplotlib.figure import Figure
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.text import Text

from zoo.base.terminal import printable
from zoo.base.whole_file import write_whole
from zoo.benchmark.checked_result import read_result
from zoo.benchmark.marks import Reached, marks_table, missed_line
from zoo.benchmark.result import (
    VERSION,
    BenchmarkResult,
    Driver,
    DriveRecord,
    Interval,
    digest_of_drives,
    write_result,
)
from zoo.benchmark.suite import LAPS, Suite
from zoo.benchmark.summary import outside_metrics, summarize_drives
from zoo.cli.closing_lines import print_written
from zoo.drives.interval_plot import interval_plot
from zoo.drives.metrics import DRIVES, METRICS
from zoo.runs.code_fingerprint import code_fingerprint
from zoo.runs.page import Page
from zoo.runs.table import Column, Table, interval_column, with_interval
from zoo.runs.table_files import Result

PAGE = "benchmark.html"
# Columns by key of a group's figures: heading, factor and format.
COLUMNS = {
    "autonomy": ("autonomy, %", 100, "{:.1f}"),
    "m_per_intervention": ("metres per intervention", 1, "{:,.0f}"),
    "cte_mean_m": ("mean error, m", 1, "{:.2f}"),
    "steering_per_s": ("steering change, 1/s", 1, "{:.2f}"),
    "without_intervention": ("drives without intervention (interval in %)", 100, "{:.0f}"),
}
DIFFERENCES = {
    "autonomy": ("autonomy, %-points", 100, "{:+.1f}"),
    "cte_mean_m": ("mean error, m", 1, "{:+.2f}"),
}
SHORT = ("autonomy", "m_per_intervention", "cte_mean_m")
NAMES_WIDTH, GAP = 12, 3  # of the first column, and before every other one, in characters
INTERVALS = (
    "95 % interval. Means: bootstrap over roads and training seeds; counts: exact Poisson and "
    "Wilson. Fewer than 3 roads: no interval."
)
CAPTION = f"Below or behind each figure: its {INTERVALS}"


def entry_result(
    name: str, suite: Suite, drivers: Sequence[Driver], drives: Sequence[DriveRecord]
) -> BenchmarkResult:
    """Return the result of an entry, with the figures of its groups.

    Args:
        name: name of the entry.
        suite: suite that was driven.
        drivers: drivers of the entry.
        drives: drives of each driver in turn.
    """
    return BenchmarkResult(
        version=VERSION,
        suite=suite.name,
        roads=suite.roads,
        code=code_fingerprint(),
        entry=name,
        checkpoints=list(drivers),
        drives=list(drives),
        **vars(summarize_drives(drives)),
        digest=digest_of_drives(drives),
    )


@dataclass(frozen=True, repr=False)
class Benchmarked(Result):
    """The drives of an entry on a suite's roads.

    Attributes:
        folder: folder with `result.json`.
        result: contents of `result.json`.
        reached: marks of the suite, and whether they are reached.
        written: paths of the files written, `result.json` first.
        suite: suite as the user named it.
    """

    folder: Path
    result: BenchmarkResult
    reached: Sequence[Reached]
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
    def headline(self) -> Interval:
        """Return the interquartile mean of the autonomy over all roads but the laps."""
        return self.result.headline

    @property
    def problem(self) -> str:
        """Return what makes the benchmark fail; empty if nothing does."""
        return nan_line(self.result) or missed_line(self.reached)

    def __fspath__(self) -> str:
        """Return the folder, so that commands take the result as a path."""
        return str(self.folder)

    def __repr__(self) -> str:
        name = f"{self.result.entry}, suite {self.result.suite}"
        return f"Benchmarked in {self.folder}: {name}\n  {headline_line(self.result)}"

    def show(self) -> None:
        """Print the figures, the marks that are reached, and what was written."""
        console = Console(emoji=False)
        print_result(self.result, console)
        if self.reached:
            table = marks_table(self.result.model_dump(), self.reached)
            console.print(table.printed(title="Marks", box=SIMPLE_HEAD), highlight=False)
        # A suite of the user's is named to verify it.
        named = [f"suite={self.suite}"] if self.suite.endswith((".yaml", ".yml")) else []
        print_written(self.written, ["benchmark", "verify", self.written[0], *named], console)

    def result_table(self) -> Table:
        """Return a row for each group of roads."""
        return groups_table(self.result)

    def plot(self) -> Figure:
        """Return the autonomy of each group with its 95 % interval."""
        groups = {name: one["autonomy"] for name, one in self.result.groups.items()}
        return interval_plot(groups, f"autonomy of {self.result.entry} (%)")


def table_columns() -> tuple[str, ...]:
    """Return the names of all columns that a table of drives here has."""
    return ("group", "drives", *COLUMNS, *(name for name in METRICS if name not in METRICS.own()))


def groups_table(result: BenchmarkResult) -> Table:
    """Return a row for each group of roads."""
    groups, drives = result.groups.values(), [result.of_group(one) for one in result.groups]
    counts = list(map(len, drives))
    columns = [
        Column("group", "group", list(result.groups)),
        Column("drives", "drives", list(map(str, counts)), {"drives": counts}),
    ]
    for key, (heading, factor, form) in COLUMNS.items():
        figures = [one[key] for one in groups]
        columns.append(interval_column(key, heading, figures, form, factor, key in SHORT))
    for key in outside_metrics(result.drives):  # their part may not be named here
        heading, form = METRICS[key].row(DRIVES) if key in METRICS else (key, "{:.4g}")
        figures = [one[key] for one in groups]
        columns.append(interval_column(key, heading, figures, form))
    last = len(COLUMNS) + 1
    kept = [sum(not one.figures["interventions"] for one in own) for own in drives]
    counted = [
        f"{of} of {count}" + "".join(text.partition(" (")[1:])
        for of, count, text in zip(kept, counts, columns[last].cells, strict=True)
    ]
    columns[last] = replace(columns[last], cells=counted)
    title = f"{result.entry} on the suite {result.suite}"
    return Table(columns, f"{title}. In brackets: {INTERVALS}")


def print_result(result: BenchmarkResult, console: Console) -> None:
    """Print a table with a column for each group, the differences, headline and digest."""
    names, *groups = groups_table(result).narrow().turned().columns
    tables = _side_by_side(groups, console.width - NAMES_WIDTH)
    for number, part in enumerate(tables, 1):
        title = Text(printable(f"{result.entry}, suite {result.suite}"))
        shown = Table([names, *part]).printed(
            left=1,
            whole=range(1, len(groups) + 1),
            title=title if number == 1 else None,
            caption=CAPTION if number == len(tables) else " ",
            caption_justify="left",
            box=SIMPLE_HEAD,
            show_edge=False,
            pad_edge=False,
        )
        shown.columns[0].min_width = NAMES_WIDTH
        console.print(shown)
    digest = f"digest of the drives: {result.digest}"
    for line in (*difference_lines(result), headline_line(result), digest):
        console.print(printable(line), highlight=False, markup=False, soft_wrap=True)


def _side_by_side(columns: Sequence[Column], width: int) -> list[list[Column]]:
    """Return columns in parts, each of which fits a width beside the names of its rows."""
    parts: list[list[Column]] = []
    room = 0
    for column in columns:
        column = replace(column, heading=printable(column.heading))
        texts = (column.heading, *column.cells)
        wide = GAP + max(len(line) for text in texts for line in text.split("\n"))
        if wide > room:
            parts.append([])
            room = width
        parts[-1].append(column)
        room -= wide
    return parts


def difference_lines(result: BenchmarkResult) -> list[str]:
    """Return a sentence for each shifted group: its difference to the clean partners."""
    lines = []
    for group, figures in result.differences.items():
        texts = [
            f"{heading}: {with_interval(figures[key], form, factor)}"
            for key, (heading, factor, form) in DIFFERENCES.items()
        ]
        line = f"{group} minus clean drives of the same roads: {'; '.join(texts)}"
        is_known = figures["autonomy"].low is not None
        lines.append(line if is_known else f"{line} (fewer than 3 roads: no interval)")
    return lines


def headline_line(result: BenchmarkResult) -> str:
    """Return the headline as a sentence."""
    seeds = len(result.checkpoints)
    trained = any(one.sha256 for one in result.checkpoints)
    by = f"{seeds} training seed{'' if seeds == 1 else 's'}"
    first = result.of_checkpoint(0)
    roads = sum(one.group != LAPS for one in first) or len(first)
    return (
        f"autonomy, interquartile mean over {roads} roads: "
        f"{with_interval(result.headline, '{:.1f}', 100)} %; "
        f"{by if trained else 'without training'}"
    )


def nan_line(result: BenchmarkResult) -> str:
    """Return a warning if the network steered NaN in a drive; empty if it did not."""
    lost = [one for one in result.drives if one.figures.get("nan_frames")]
    if not lost:
        return ""
    frames = sum(int(one.figures["nan_frames"] or 0) for one in lost)
    return (
        f"{result.checkpoints[lost[0].checkpoint].file}: the network steered NaN in {frames:,} "
        "frames: these figures are not the network's; train again with a smaller optim.lr"
    )


def write_entry(folder: Path, result: BenchmarkResult) -> list[Path]:
    """Write `result.json` and `benchmark.html`; return their paths."""
    page = Page(Path(__file__).with_name("static") / PAGE).render(
        title=f"{result.entry}, suite {result.suite}",
        result=result,
        lead=headline_line(result),
        groups=groups_table(result),
        differences=difference_lines(result),
        caption=CAPTION,
        checkpoints=_checkpoints_table(result),
        drives=_drives_table(result),
    )
    return [write_result(folder, result), write_whole(folder / PAGE, page)]


def _checkpoints_table(result: BenchmarkResult) -> Table:
    names = {
        "file": "file",
        "model": "network",
        "parameters": "parameters",
        "training_seed": "training seed",
        "data": "training data",
        "sha256": "SHA-256",
    }
    rows = []
    for number, one in enumerate(result.checkpoints, 1):
        values = one.model_dump() | {"parameters": f"{one.parameters:,}"}
        texts = ("-" if values[name] in (None, "") else str(values[name]) for name in names)
        rows.append([str(number), *texts])
    return Table.of(["number", *names.values()], rows)


def _drives_table(result: BenchmarkResult) -> Table:
    forms = {
        "autonomy": ("autonomy", "{:.1%}"),
        "interventions": ("interventions", "{:.0f}"),
        "cte_mean_m": ("mean error, m", "{:.2f}"),
        "steering_per_s": ("steering change, 1/s", "{:.2f}"),
    }
    rows = []
    for drive in result.drives:
        settings = ", ".join(f"{key}: {value}" for key, value in drive.settings.items())
        settings = settings.translate({ord(sign): None for sign in "{}'"})
        texts = [form.format(drive.figures[name]) for name, (_, form) in forms.items()]
        number = str(drive.checkpoint + 1)
        rows.append([drive.group, drive.track, settings, number, *texts, drive.digest])
    names = [heading for heading, _ in forms.values()]
    return Table.of(["group", "road", "settings", "checkpoint", *names, "digest"], rows)

"""The result of `drivezoo benchmark`: its table and its plot, and how it is printed."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from matplotlib.figure import Figure
from rich.console import Console

from zoo.benchmark.checked_result import read_result
from zoo.benchmark.entry import nan_line
from zoo.benchmark.marks import Reached, missed_line
from zoo.benchmark.marks_page import print_marks
from zoo.benchmark.result import BenchmarkResult, Interval
from zoo.benchmark.table import COLUMNS, INTERVALS, headline_line, print_result, table_cells
from zoo.drives.interval_plot import interval_plot
from zoo.runs.result_table import Cell, Result, ResultTable, TableColumn
from zoo.runs.table_text import interval_figures

TABLE_COLUMNS = ("group", "drives", *COLUMNS)
SHORT = ("group", "drives", "autonomy", "m_per_intervention", "cte_mean_m")


@dataclass(frozen=True, repr=False)
class Benchmarked(Result):
    """The drives of an entry on a suite's roads.

    Attributes:
        folder: folder with `result.json`.
        result: contents of `result.json`.
        reached: marks of the suite, and whether they are reached.
        written: paths of the files written.
    """

    folder: Path
    result: BenchmarkResult
    reached: Sequence[Reached]
    written: list[Path] = field(default_factory=list)

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

    def __repr__(self) -> str:
        name = f"{self.result.entry}, suite {self.result.suite}"
        return f"Benchmarked in {self.folder}: {name}\n  {headline_line(self.result)}"

    def result_table(self) -> ResultTable:
        """Return a row for each group of roads."""
        groups, (headings, cells) = self.result.groups, table_cells(self.result)
        figures: list[dict[str, Sequence[Cell]]] = [
            {"group": list(groups)},
            {"drives": [len(self.result.of_group(one)) for one in groups]},
            *(interval_figures(key, [one[key] for one in groups.values()]) for key in COLUMNS),
        ]
        texts = [[row[number] for row in cells] for number in range(len(headings))]
        columns = [
            TableColumn(name, heading, one, values, short=name in SHORT)
            for name, heading, one, values in zip(
                TABLE_COLUMNS, headings, texts, figures, strict=True
            )
        ]
        title = f"{self.result.entry} on the suite {self.result.suite}"
        return ResultTable(columns, f"{title}. In brackets: {INTERVALS}")

    def plot(self) -> Figure:
        """Return the autonomy of each group with its 95 % interval."""
        groups = {name: one["autonomy"] for name, one in self.result.groups.items()}
        return interval_plot(groups, f"autonomy of {self.result.entry} (%)")


def print_benchmarked(found: Benchmarked, console: Console) -> None:
    """Print the figures of an entry, and the marks that it reaches."""
    print_result(found.result, console)
    if found.reached:
        print_marks(found.result.model_dump(), found.reached, console)

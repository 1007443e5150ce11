"""The result of `drivezoo compare`: its table and its plot."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from matplotlib.figure import Figure

from zoo.base.whole_file import json_text, write_output
from zoo.compare.comparison_table import HEADINGS, INTERVALS, comparison_cells, conclusion
from zoo.compare.differences import Comparison, compare_entries
from zoo.compare.paired_drives import Entry, read_pair
from zoo.drives.interval_plot import interval_plot
from zoo.runs.result_table import Cell, Result, ResultTable, TableColumn
from zoo.runs.table_text import interval_figures

VERSION = 1  # of the JSON file
ESTIMATES = ("autonomy", "cte_mean_m", "a_better")


@dataclass(frozen=True, repr=False)
class ComparedEntries(Result):
    """Two results of the benchmark, A and B, on the same roads.

    Attributes:
        a: the first result.
        b: the second result.
        groups: comparison of each group of roads, and of all of them.
    """

    a: Entry
    b: Entry
    groups: Mapping[str, Comparison]

    @classmethod
    def read(cls, first: str | Path, second: str | Path) -> "ComparedEntries":
        """Compare two files `result.json`, or their folders.

        Raises:
            InputError: a result cannot be read, or the results are of different roads.
        """
        a, b = read_pair(Path(first).expanduser(), Path(second).expanduser())
        return cls(a, b, compare_entries(a, b))

    @property
    def lines(self) -> Sequence[str]:
        """Return the verdict, what limits it, and the training seeds needed."""
        return conclusion(self.a, self.b, self.groups)

    def __repr__(self) -> str:
        names = f"A: {self.a.result.entry}, B: {self.b.result.entry}"
        return "\n".join([f"ComparedEntries of {names}", *(f"  {one}" for one in self.lines)])

    def result_table(self) -> ResultTable:
        """Return a row for each group of roads; differences are A minus B."""
        figures = {"group": {}} | _figures(list(self.groups.values()))
        texts = zip(*comparison_cells(self.groups), strict=True)
        columns = [
            TableColumn(name, heading, cells, figures[name])
            for (name, heading), cells in zip(HEADINGS.items(), texts, strict=True)
        ]
        names = f"A: {self.a.result.entry}, B: {self.b.result.entry}"
        return ResultTable(columns, f"A minus B; {names}. In brackets: {INTERVALS}")

    def plot(self) -> Figure:
        """Return the difference in autonomy of each group with its 95 % interval."""
        label = f"autonomy, {self.a.result.entry} minus {self.b.result.entry} (points)"
        return interval_plot({name: one.autonomy for name, one in self.groups.items()}, label, 0.0)

    def write(self, path: Path) -> Path:
        """Write all figures as JSON; return the path.

        Raises:
            InputError: see `write_output`.
        """
        written = {
            "version": VERSION,
            "suite": self.a.result.suite,
            "roads": self.a.result.roads,
            "a": {"entry": self.a.result.entry, "training_seeds": self.a.seeds},
            "b": {"entry": self.b.result.entry, "training_seeds": self.b.seeds},
            "groups": {name: asdict(one) for name, one in self.groups.items()},
        }
        return write_output(path, json_text(written))


def _figures(compared: Sequence[Comparison]) -> dict[str, dict[str, Sequence[Cell]]]:
    """Return by printed column its figures in the groups, by name."""
    found: dict[str, dict[str, Sequence[Cell]]] = {
        "roads": {"roads": [one.roads for one in compared]}
    }
    for name in ESTIMATES:
        found[name] = {**interval_figures(name, [getattr(one, name) for one in compared])}
    for name in compared[0].a:
        found[name] |= {f"{name}_a": [one.a[name] for one in compared]}
        found[name] |= {f"{name}_b": [one.b[name] for one in compared]}
    found["verdict"] = {
        "verdict": [one.verdict for one in compared],
        "needed": [one.needed.reason for one in compared],
        "needed_seeds": [one.needed.seeds for one in compared],
    }
    return found

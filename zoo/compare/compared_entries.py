"""The result of `drivezoo compare`: its table and its plot."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from matplotlib.figure import Figure

from zoo.compare.comparison_table import HEADINGS, comparison_cells, conclusion
from zoo.compare.differences import Comparison, compare_entries
from zoo.compare.paired_drives import Entry, read_pair
from zoo.drives.interval_plot import interval_plot
from zoo.runs.result_table import Cell, Result, ResultTable
from zoo.runs.whole_file import json_text, write_whole

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
        rows = [{"group": name, **_figures(one)} for name, one in self.groups.items()]
        headings = [" ".join(one.split()) for one in HEADINGS]
        return ResultTable(rows, headings, comparison_cells(self.groups))

    def plot(self) -> Figure:
        """Return the difference in autonomy of each group with its 95 % interval."""
        label = f"autonomy, {self.a.result.entry} minus {self.b.result.entry} (points)"
        return interval_plot({name: one.autonomy for name, one in self.groups.items()}, label, 0.0)

    def write(self, path: Path) -> Path:
        """Write all figures as JSON; return the path.

        Raises:
            OSError: the file cannot be written.
        """
        written = {
            "version": VERSION,
            "suite": self.a.result.suite,
            "roads": self.a.result.roads,
            "a": {"entry": self.a.result.entry, "training_seeds": self.a.seeds},
            "b": {"entry": self.b.result.entry, "training_seeds": self.b.seeds},
            "groups": {name: asdict(one) for name, one in self.groups.items()},
        }
        path.parent.mkdir(parents=True, exist_ok=True)
        return write_whole(path, json_text(written))


def _figures(one: Comparison) -> dict[str, Cell]:
    figures: dict[str, Cell] = {"roads": one.roads}
    figures |= {f"{name}_a": value for name, value in one.a.items()}
    figures |= {f"{name}_b": value for name, value in one.b.items()}
    for name in ESTIMATES:
        estimate = getattr(one, name)
        figures |= {
            name: estimate.value,
            f"{name}_low": _known(estimate.low),
            f"{name}_high": _known(estimate.high),
        }
    needed = {"needed": one.needed.reason, "needed_seeds": one.needed.seeds}
    return figures | {"verdict": one.verdict} | needed


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None

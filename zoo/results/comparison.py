"""The result of `drivezoo compare`: its table, its plot, and how it is printed."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

from matplotlib.figure import Figure
from rich.box import SIMPLE_HEAD
from rich.console import Console

from zoo.base.terminal import counted, print_line, print_written, printable
from zoo.base.whole_file import json_text, write_output
from zoo.driving.intervals import Estimate
from zoo.results.differences import (
    OVERALL,
    Comparison,
    Entry,
    Needed,
    compare_entries,
    read_entries,
    shared_seeds,
)
from zoo.results.result import SCORES
from zoo.runs.plots import interval_plot
from zoo.runs.result_table import Cell, Column, Table, interval_figures, known, with_interval
from zoo.runs.table_files import Result

VERSION = 1  # of the JSON file
INTERVALS = (
    "95 % interval over roads and training seeds, from three roads on. p: of the difference; those "
    "of the groups are corrected for their number (Holm). To tell: training seeds of each entry "
    "that would decide with a probability of 80 %."
)
COLUMNS = ("group", "roads", "autonomy", "a_better", "p", "verdict")
NEEDED = {
    "decided": "",
    "equal": "harder roads: both have the same score",
    "roads": "more roads",
    "many": "more than 100 training seeds",
    "unknown": "three or more training seeds, to estimate how many",
}


@dataclass(frozen=True, repr=False)
class ComparedEntries(Result):
    """Two results of the benchmark, A and B, on the same roads.

    Attributes:
        a: the first result.
        b: the second result.
        groups: comparison of each group of roads, and of all of them.
        paired: whether trainings of the same seed are pairs.
        written: paths of the files written.
    """

    a: Entry
    b: Entry
    groups: Mapping[str, Comparison]
    paired: bool = False
    written: list[Path] = field(default_factory=list)

    @classmethod
    def read(cls, first: str | Path, second: str | Path, paired: bool = False) -> "ComparedEntries":
        """Compare two files `result.json`, or their folders; `paired` as in `compare_entries`.

        Raises:
            InputError: a result cannot be read, or the results are of different roads, or, with
                `paired`, share no training seed.
        """
        a, b = read_entries(Path(first).expanduser(), Path(second).expanduser())
        return cls(a, b, compare_entries(a, b, paired), paired)

    @property
    def lines(self) -> list[str]:
        """Return the verdict over all groups, what limits it, and what is needed to tell."""
        name, overall = list(self.groups.items())[-1]
        where = counted(overall.roads, "drive") + f" of group {name}" * (name != OVERALL)
        first, second = (f"{scores[self._score]:.1%}" for scores in (overall.a, overall.b))
        what = SCORES[self._score]
        lines = [f"verdict: {overall.verdict} ({what} {first} and {second} in {where})"]
        pair = (self.a, self.b)
        if single := [side.result.entry for side in pair if side.seeds == 1]:
            lines.append(
                f"{' and '.join(single)}: one training seed: how trainings differ is unknown, so "
                "that neither drives better"
            )
        if self.a.result.code.get("hash") != self.b.result.code.get("hash"):
            lines.append("A and B were driven by different versions of the code; drive both by one")
        if self.paired:
            seeds = ", ".join(map(str, shared_seeds(*pair)))
            lines.append(f"paired: trainings of the same seed ({seeds})")
        if text := needed_text(overall.needed):
            lines.append(f"to tell: {text}")
        return lines

    def __repr__(self) -> str:
        return "\n  ".join([f"ComparedEntries of {self._names}", *self.lines])

    @property
    def _score(self) -> str:
        return self.a.result.score

    @property
    def _names(self) -> str:
        return f"A: {self.a.result.entry}, B: {self.b.result.entry}"

    def show(self) -> None:
        """Print a row for each group, the verdict, and what was written."""
        console = Console(emoji=False, soft_wrap=True)
        console.width = max(console.width, 76)  # a narrower table would lose figures
        for name, entry in (("A", self.a), ("B", self.b)):
            how = f"training seeds: {entry.seeds}" if entry.seeds else "a baseline"
            print_line(console, printable(f"{name}: {entry.result.entry}, {how} ({entry.path})"))
        shown = self.result_table().narrow()
        table = shown.printed(
            left=1,
            whole=range(len(COLUMNS) - 1),
            title="A minus B",
            caption=f"Below each figure: its {INTERVALS}",
            caption_justify="left",
            box=SIMPLE_HEAD,
            show_edge=False,
        )
        table.columns[-1].min_width = 10
        console.print(table)
        for line in self.lines:
            print_line(console, printable(line))
        print_written(self.written, console=console)

    def result_table(self) -> Table:
        """Return a row for each group of roads; differences are A minus B."""
        compared = list(self.groups.values())
        roads, verdicts = [row.roads for row in compared], [row.verdict for row in compared]
        texts = [
            f"{row.verdict.replace(' drives', '')}\n{needed_text(row.needed)}" for row in compared
        ]
        p_values = [row.p for row in compared]
        figures: dict[str, Sequence[Cell]] = {
            "verdict": verdicts,
            "needed": [row.needed.reason for row in compared],
            "needed_seeds": [row.needed.seeds for row in compared],
        }
        columns = [
            Column("group", "group", list(self.groups)),
            Column("roads", "drives", list(map(str, roads)), {"roads": roads}),
            self._column("difference", f"{SCORES[self._score]},\npoints", "{:+.1f}", 100),
            self._column("a_better", "A better,\n%", "{:.0f}", 100),
            Column("p", "p", list(map("{:.3f}".format, p_values)), {"p": p_values}),
            Column("verdict", "verdict,\nto tell", texts, figures),
        ]
        return Table(columns, f"A minus B; {self._names}. In brackets: {INTERVALS}")

    def _column(self, name: str, heading: str, form: str, factor: float = 1) -> Column:
        """Return a column of estimates, with the figures of A and B where they have such."""
        compared = list(self.groups.values())
        estimates = [getattr(row, name) for row in compared]
        name = self._score if name == "difference" else name
        figures = interval_figures(name, estimates)
        if name in compared[0].a:
            figures[f"{name}_a"] = [row.a[name] for row in compared]
            figures[f"{name}_b"] = [row.b[name] for row in compared]
        texts = [_estimate(estimate, form, factor) for estimate in estimates]
        return Column(name, heading, texts, figures)

    def plot(self) -> Figure:
        """Return the difference in the score of each group with its 95 % interval."""
        label = f"{SCORES[self._score]}, {self.a.result.entry} minus {self.b.result.entry} (points)"
        differences = {name: group.difference for name, group in self.groups.items()}
        return interval_plot(differences, label, 0.0)

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
            "paired": self.paired,
            "groups": {name: asdict(group) for name, group in self.groups.items()},
        }
        return write_output(path, json_text(written))


def needed_text(needed: Needed) -> str:
    """Return what would decide: more training seeds of each entry, or other roads.

    >>> needed_text(Needed(7, "seeds"))
    'about 7 training seeds'
    """
    return NEEDED.get(needed.reason, f"about {needed.seeds} training seeds")


def _estimate(figure: Estimate, form: str, factor: float = 1) -> str:
    """Return a figure, multiplied by a factor, with its interval."""
    text = with_interval(figure, form, factor)
    return f"{text} (no interval)" if known(figure.low) is None else text

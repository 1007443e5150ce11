"""The result of `drivezoo compare`: its table, its plot, and how it is printed."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

from matplotlib.figure import Figure
from rich.box import SIMPLE_HEAD
from rich.console import Console

from zoo.base.terminal import printable
from zoo.base.whole_file import json_text, write_output
from zoo.cli.closing_lines import print_written
from zoo.compare.differences import (
    A_BETTER,
    CANNOT_TELL,
    OVERALL,
    Comparison,
    Entry,
    Needed,
    compare_entries,
    read_pair,
    verdict_on,
)
from zoo.drives.bootstrap import Estimate
from zoo.drives.interval_plot import interval_plot
from zoo.runs.table import Cell, Column, Table, interval_figures, known, two_lines, with_interval
from zoo.runs.table_files import Result

VERSION = 1  # of the JSON file
INTERVALS = (
    "95 % interval (bootstrap over roads and training seeds), from three roads on. Each verdict "
    "is by autonomy and for its row alone: one of 20 equal pairs is told apart by chance. To tell: "
    "training seeds of each entry that would decide with a probability of 80 %."
)
COLUMNS = ("group", "roads", "autonomy", "cte_mean_m", "a_better", "verdict")
NEEDED = {
    "decided": "",
    "equal": "equal",
    "roads": "more roads",
    "many": ">100 seeds",
    "unknown": "more seeds",
}
ADVICE = {
    "equal": "both have the same autonomy, so no number of training seeds can be named; use a "
    "suite of harder roads",
    "roads": "to tell: more roads, three or more, because the difference varies too much between "
    "these; more training seeds would not decide",
    "many": "more than 100 training seeds of each entry would be needed to tell",
    "unknown": "how many training seeds would be needed cannot be estimated from one training "
    "seed; benchmark three or more of each entry",
}


@dataclass(frozen=True, repr=False)
class ComparedEntries(Result):
    """Two results of the benchmark, A and B, on the same roads.

    Attributes:
        a: the first result.
        b: the second result.
        groups: comparison of each group of roads, and of all of them.
        written: paths of the files written.
    """

    a: Entry
    b: Entry
    groups: Mapping[str, Comparison]
    written: list[Path] = field(default_factory=list)

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
        return "\n".join([f"ComparedEntries of {self._names}", *(f"  {one}" for one in self.lines)])

    @property
    def _names(self) -> str:
        return f"A: {self.a.result.entry}, B: {self.b.result.entry}"

    def show(self) -> None:
        """Print the comparison and what was written."""
        console = Console(emoji=False)
        print_comparison(self, console)
        print_written(self.written, console=console)

    def result_table(self) -> Table:
        """Return a row for each group of roads; differences are A minus B."""
        compared = list(self.groups.values())
        roads, needed = [one.roads for one in compared], [one.needed for one in compared]
        verdicts = [one.verdict for one in compared]
        texts = [
            f"{verdict.replace(' drives', '')}\n{NEEDED.get(one.reason, f'{one.seeds} seeds')}"
            for verdict, one in zip(verdicts, needed, strict=True)
        ]
        figures: dict[str, Sequence[Cell]] = {
            "verdict": verdicts,
            "needed": [one.reason for one in needed],
            "needed_seeds": [one.seeds for one in needed],
        }
        columns = [
            Column("group", "group", list(self.groups)),
            Column("roads", "drives", list(map(str, roads)), {"roads": roads}),
            self._column("autonomy", "autonomy,\npoints", "{:+.1f}", 100),
            self._column("cte_mean_m", "mean error,\nm", "{:+.2f}"),
            self._column("a_better", "A better,\n%", "{:.0f}", 100),
            Column("verdict", "verdict,\nto tell", texts, figures),
        ]
        return Table(columns, f"A minus B; {self._names}. In brackets: {INTERVALS}")

    def _column(self, name: str, heading: str, form: str, factor: float = 1) -> Column:
        """Return a column of estimates, with the figures of A and B where they have such."""
        compared = list(self.groups.values())
        estimates = [getattr(one, name) for one in compared]
        figures = interval_figures(name, estimates)
        if name in compared[0].a:
            figures[f"{name}_a"] = [one.a[name] for one in compared]
            figures[f"{name}_b"] = [one.b[name] for one in compared]
        return Column(name, heading, [_estimate(one, form, factor) for one in estimates], figures)

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


def print_comparison(compared: ComparedEntries, console: Console) -> None:
    """Print a row for each group, then the verdict, its limits and the training seeds needed."""
    entries, lines = [], list(compared.lines)
    for name, entry in (("A", compared.a), ("B", compared.b)):
        seeds = f"{entry.seeds} training seed{'' if entry.seeds == 1 else 's'}"
        how = seeds if entry.is_trained else "a baseline without training"
        entries.append(f"{name}: {entry.result.entry}, {how} ({entry.path})")
    shown = compared.result_table().narrow()
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
    for part in (*entries, table, *lines):
        text = printable(part) if isinstance(part, str) else part
        console.print(text, highlight=False, markup=False, soft_wrap=isinstance(part, str))


def conclusion(a: Entry, b: Entry, comparisons: Mapping[str, Comparison]) -> list[str]:
    """Return the verdict over all groups, what limits it, and the training seeds needed."""
    name, overall = next(reversed(comparisons.items()))
    where = f"{overall.roads} roads" + ("" if name == OVERALL else f" of group {name}")
    first, second = (f"{one['autonomy']:.1%}" for one in (overall.a, overall.b))
    lines = [f"verdict: {overall.verdict} (autonomy {first} and {second} on {where})"]
    if (nearer := verdict_on(overall.cte_mean_m)) != CANNOT_TELL:
        name = "B" if nearer == A_BETTER else "A"  # A_BETTER: A's error is greater
        metres = two_lines(_estimate(overall.cte_mean_m, "{:+.2f}"))
        metres = metres.replace("\n", " m, 95 %: ")
        lines.append(f"mean error: {name} stays nearer to the centre ({metres} m)")
    if single := [one for one in (a, b) if one.seeds == 1 and one.is_trained]:
        named = " and ".join(one.result.entry for one in single)
        lines.append(
            f"{named}: one training seed: the intervals leave out how trainings differ, so another "
            "training may drive better or worse"
        )
    if a.result.code.get("hash") != b.result.code.get("hash"):
        lines.append("A and B were driven by different versions of the code; drive both with one")
    if overall.verdict == CANNOT_TELL:
        lines.append(advice(overall.needed))
    return lines


def advice(needed: Needed) -> str:
    """Return a sentence on the training seeds needed.

    >>> advice(Needed(7, "seeds"))
    'to tell: about 7 training seeds of each entry, a rough number from the variance of these'
    """
    if needed.seeds is None:
        return ADVICE[needed.reason]
    return (
        f"to tell: about {needed.seeds} training seeds of each entry, a rough number from the "
        "variance of these"
    )


def _estimate(figure: Estimate, form: str, factor: float = 1) -> str:
    """Return a figure, multiplied by a factor, with its interval."""
    text = with_interval(figure, form, factor)
    return f"{text} (no interval)" if known(figure.low) is None else text

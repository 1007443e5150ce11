"""Functions of measurements and studies: commands, tables, CSV files, and fair turns of measures.

A part of `make bench` is a file here with `measure(short) -> list[Row]`.
"""

import csv
import multiprocessing
import os
import statistics
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import TypeVar
from unittest.mock import patch

import numpy as np
from rich.console import Console
from rich.table import Table

from zoo.base.file_text import csv_text
from zoo.base.whole_file import write_whole
from zoo.training.host_settings import limit_spinning

TextRow = Mapping[str, str]  # of a study's CSV file
Rows = Sequence[TextRow]
COLUMNS = "against", "ratio", "middle half", "aim", "met"
Found = TypeVar("Found")  # what a measure returns


def make_console() -> Console:
    """Return a console; without a terminal it is wide enough for tables."""
    console = Console(emoji=False)
    return console if console.is_terminal else Console(width=140, emoji=False)


def write_between(page: Path, marker: str, text: str) -> None:
    """Replace what stands between `<!-- MARKER -->` and `<!-- end of ... -->` of a page.

    The last marker has the first word of `results of lenet`.

    Raises:
        SystemExit: the page has no such markers; the message names page and marker.
    """
    begin, end = f"<!-- {marker} -->", f"<!-- end of {marker.partition(' of ')[0]} -->"
    before, first, rest = page.read_text().partition(begin)
    _, last, after = rest.partition(end)
    if not first or not last:
        raise SystemExit(f"{page}: has no {begin} ... {end}; add both where the table belongs")
    page.write_text(f"{before}{begin}\n{text}\n{end}{after}")


def markdown_table(head: list[str], rows: list[list[str]], left: int = 1) -> str:
    """Return a table in Markdown whose first `left` columns are aligned to the left.

    >>> print(markdown_table(["name", "size"], [["a", "1"]]))
    | name | size |
    |---|---:|
    | a | 1 |
    """
    rule = ["---"] * left + ["---:"] * (len(head) - left)
    lines = [f"| {' | '.join(cells)} |" for cells in (head, *rows)]
    return "\n".join([lines[0], f"|{'|'.join(rule)}|", *lines[1:]])


def grouped(rows: Iterable[TextRow], keys: Sequence[str]) -> list[list[TextRow]]:
    """Return rows with the same values of some columns together, in the order of the first."""
    groups: dict[tuple[str, ...], list[TextRow]] = {}
    for row in rows:
        groups.setdefault(tuple(row[key] for key in keys), []).append(row)
    return list(groups.values())


def read_csv(path: Path) -> list[dict[str, str]]:
    """Return the rows of a CSV file, all as text; none where it does not exist."""
    if not path.is_file():
        return []
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def write_csv(path: Path, rows: Sequence[Mapping[str, object]]) -> None:
    """Write rows as a CSV file; a cell is empty where a row lacks a key."""
    head = list(dict.fromkeys(name for row in rows for name in row))
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, csv_text([head, *(map(row.get, head) for row in rows)], exact=True))


def merge(old: Rows, new: Rows, key: Sequence[str], sort: Sequence[str] = ()) -> list[TextRow]:
    """Return rows with new ones in place of those with the same key, and further ones at the end.

    Args:
        old: rows of the file.
        new: rows that were measured, with values of any type.
        key: columns that tell rows apart.
        sort: columns by whose text the rows are sorted.
    """
    rows = {tuple(row[name] for name in key): row for row in old}
    rows |= {tuple(str(row[name]) for name in key): row for row in new}
    return sorted(rows.values(), key=lambda row: [str(row[name]) for name in sort])


@dataclass(frozen=True)
class Row:
    """A line of the table.

    Attributes:
        what: measured work.
        reference: work that it is compared with.
        ratio: the measured figure divided by its reference's: lower quartile, median and upper
            quartile over the rounds, or one number without rounds.
        aim: ratio to reach; None for a row without an aim.
        at_least: whether a larger ratio is better.
        figures: medians behind the ratio, with units in their names.
    """

    what: str
    reference: str
    ratio: Sequence[float]
    aim: float | None = None
    at_least: bool = True
    figures: dict[str, float] = field(default_factory=dict)

    @property
    def value(self) -> float:
        """Return the ratio as a number."""
        return self.ratio[len(self.ratio) // 2]

    @property
    def met(self) -> str:
        """Return `yes`, `no`, or `noisy` for an aim between the quartiles; empty without an aim."""
        if self.aim is None:
            return ""
        if self.ratio[0] < self.aim < self.ratio[-1]:
            return "noisy"
        reached = self.value >= self.aim if self.at_least else self.value <= self.aim
        return "yes" if reached else "no"

    def cells(self) -> list[str]:
        """Return the table's columns after the first one."""
        spread = f"{self.ratio[0]:.2f} to {self.ratio[-1]:.2f}" if len(self.ratio) > 1 else ""
        sign = "at least" if self.at_least else "at most"
        aim = "" if self.aim is None else f"{sign} {self.aim:.3g}"
        return [self.reference, f"{self.value:.2f}", spread, aim, self.met]


def take_turns(measures: dict[str, Callable[[], Found]], rounds: int) -> dict[str, list[Found]]:
    """Call each measure once per round, so that other load affects all of them equally."""
    figures: dict[str, list[Found]] = {name: [] for name in measures}
    for _ in range(rounds):
        for name, measure in measures.items():
            figures[name].append(measure())
    return figures


def seconds_of(work: Callable[[], object], clock: Callable[[], float] = time.perf_counter) -> float:
    """Return the seconds of a call by a clock, such as `time.process_time`."""
    began = clock()
    work()
    return clock() - began


def ratios(ours: list[float], theirs: list[float]) -> list[float]:
    """Return the quartiles over the rounds of `ours` divided by `theirs`.

    >>> ratios([2.0, 4.0, 9.0], [1.0, 2.0, 3.0])
    [2.0, 2.0, 2.5]
    """
    return np.quantile(np.divide(ours, theirs), [0.25, 0.5, 0.75]).tolist()


def medians(figures: dict[str, list[float]]) -> dict[str, float]:
    """Return medians for `Row.figures`."""
    return {name: statistics.median(values) for name, values in figures.items()}


def compared(
    figures: dict[str, list[float]],
    what: str,
    reference: str,
    names: tuple[str, str],
    aim: float | None = None,
    at_least: bool = True,
) -> Row:
    """Return the row that compares two measures of `take_turns`, by their names."""
    both = {name: figures[name] for name in names}
    return Row(what, reference, ratios(*both.values()), aim, at_least, medians(both))


@contextmanager
def contestants(
    targets: dict[str, tuple], asleep: Collection[str] = ()
) -> Iterator[dict[str, Callable[[], float]]]:
    """Run each target in its own process and yield functions that measure there.

    Processes are needed for settings that a process makes only once. `target(pipe, *arguments)`
    sends None when it is ready. Each time it receives True, it measures and sends the figure. It
    ends when it receives False.

    Args:
        targets: target and arguments by name.
        asleep: targets whose waiting threads sleep soon, as those of `drivezoo train`; by default
            they spin, which also takes processor time.
    """
    context = multiprocessing.get_context("spawn")
    with ExitStack() as stack:
        pipes = {}
        for name, (target, *arguments) in targets.items():
            pipes[name], theirs = context.Pipe()
            process = context.Process(target=target, args=(theirs, *arguments))
            with patch.dict(os.environ):
                if name in asleep:
                    limit_spinning()
                process.start()
            stack.callback(_end, process, pipes[name])
            theirs.close()
        for pipe in pipes.values():  # all start at the same time
            pipe.recv()
        yield {name: partial(_ask, pipe) for name, pipe in pipes.items()}


def _ask(pipe: Connection) -> float:
    pipe.send(True)
    return pipe.recv()


def _end(process: BaseProcess, pipe: Connection) -> None:
    with suppress(OSError):  # the process has ended
        pipe.send(False)
        process.join(30)
    process.kill()
    process.join()


def print_rows(rows: list[Row]) -> None:
    """Print the table with the figures below each row."""
    table = Table("what", *COLUMNS)
    for row in rows:
        figures = ", ".join(f"{name} {value:,.4g}" for name, value in row.figures.items())
        table.add_row(f"{row.what}\n[dim]{figures}[/dim]", *row.cells())
    make_console().print(table)

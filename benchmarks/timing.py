"""Functions of all parts of `make bench`: rows of its table, and fair turns of measurements.

A part is a file here with `measure(short) -> list[Row]`. It runs alone, by `python
benchmarks/PART.py [short]`, or together with others, by `python benchmarks/bench.py`.
"""

import json
import multiprocessing
import os
import statistics
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass, field
from functools import partial
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import TypeVar
from unittest.mock import patch

import numpy as np

from benchmarks.measuring import print_table

COLUMNS = "against", "ratio", "middle half", "aim", "met"
Found = TypeVar("Found")  # what a measure returns


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
    found: dict[str, list[Found]] = {name: [] for name in measures}
    for _ in range(rounds):
        for name, measure in measures.items():
            found[name].append(measure())
    return found


def ratios(ours: list[float], theirs: list[float]) -> list[float]:
    """Return the quartiles over the rounds of `ours` divided by `theirs`.

    >>> ratios([2.0, 4.0, 9.0], [1.0, 2.0, 3.0])
    [2.0, 2.0, 2.5]
    """
    return np.quantile(np.divide(ours, theirs), [0.25, 0.5, 0.75]).tolist()


def medians(found: dict[str, list[float]]) -> dict[str, float]:
    """Return medians for `Row.figures`."""
    return {name: statistics.median(values) for name, values in found.items()}


def compared(
    found: dict[str, list[float]],
    what: str,
    reference: str,
    names: tuple[str, str],
    aim: float | None = None,
    at_least: bool = True,
) -> Row:
    """Return the row that compares two measures of `take_turns`, by their names."""
    both = {name: found[name] for name in names}
    return Row(what, reference, ratios(*both.values()), aim, at_least, medians(both))


@contextmanager
def contestants(
    targets: dict[str, tuple], asleep: bool = False
) -> Iterator[dict[str, Callable[[], float]]]:
    """Run each target in its own process and yield functions that measure there.

    Processes are needed for settings that a process makes only once. `target(pipe, *arguments)`
    sends None when it is ready. Each time it receives True, it measures and sends the figure. It
    ends when it receives False.

    Args:
        targets: target and arguments by name.
        asleep: whether waiting threads sleep; by default they spin, which also takes processor
            time.
    """
    context = multiprocessing.get_context("spawn")
    with ExitStack() as stack:
        pipes = {}
        for name, (target, *arguments) in targets.items():
            pipes[name], theirs = context.Pipe()
            process = context.Process(target=target, args=(theirs, *arguments))
            policy = {"OMP_WAIT_POLICY": "PASSIVE"} if asleep else {}
            with patch.dict(os.environ, policy):
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
    lines = []
    for row in rows:
        figures = ", ".join(f"{name} {value:,.4g}" for name, value in row.figures.items())
        lines.append([f"{row.what}\n[dim]{figures}[/dim]", *row.cells()])
    print_table(["what", *COLUMNS], lines)


def run_part(measure: Callable[[bool], list[Row]]) -> None:
    """Run a part with the command's arguments: `[short] [out=FILE]`."""
    rows = measure("short" in sys.argv[1:])
    out = [word.removeprefix("out=") for word in sys.argv[1:] if word.startswith("out=")]
    if out:
        Path(out[0]).write_text(json.dumps([asdict(row) for row in rows]))
    else:
        print_rows(rows)

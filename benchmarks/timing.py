"""Functions of all parts of `make bench`: rows of its table, and fair turns of measurements.

A part is a file here with `measure(short) -> list[Row]`. It runs alone, by `python
benchmarks/PART.py [short]`, or together with others, by `python benchmarks/bench.py`.
"""

import json
import multiprocessing
import os
import statistics
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass, field
from functools import partial
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from unittest.mock import patch

from rich.console import Console
from rich.table import Table


@dataclass(frozen=True)
class Row:
    """A line of the table.

    Attributes:
        what: measured work.
        reference: work that it is compared with.
        ratio: the measured figure divided by its reference's, median over the rounds.
        aim: ratio to reach; None for a row without an aim.
        at_least: whether a larger ratio is better.
        figures: medians behind the ratio, with units in their names.
    """

    what: str
    reference: str
    ratio: float
    aim: float | None = None
    at_least: bool = True
    figures: dict[str, float] = field(default_factory=dict)

    @property
    def met(self) -> bool | None:
        if self.aim is None:
            return None
        return self.ratio >= self.aim if self.at_least else self.ratio <= self.aim


def take_turns(measures: dict[str, Callable[[], float]], rounds: int) -> dict[str, list[float]]:
    """Call each measure once per round, so that other load affects all of them equally."""
    found: dict[str, list[float]] = {name: [] for name in measures}
    for _ in range(rounds):
        for name, measure in measures.items():
            found[name].append(measure())
    return found


def median_ratio(ours: list[float], theirs: list[float]) -> float:
    """Return the median over rounds of `ours` divided by `theirs`."""
    return statistics.median(one / other for one, other in zip(ours, theirs, strict=True))


def medians(found: dict[str, list[float]]) -> dict[str, float]:
    """Return medians for `Row.figures`."""
    return {name: statistics.median(values) for name, values in found.items()}


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


def make_console() -> Console:
    """Return a console; without a terminal it is wide enough for the table."""
    console = Console()
    return console if console.is_terminal else Console(width=120)


def print_rows(rows: list[Row], console: Console) -> None:
    """Print the table with the figures below each row."""
    table = Table("what", "against", "ratio", "aim", "met")
    for row in rows:
        sign = "at least" if row.at_least else "at most"
        aim = "" if row.aim is None else f"{sign} {row.aim:.3g}"
        met = {None: "", True: "yes", False: "no"}[row.met]
        figures = ", ".join(f"{name} {value:,.4g}" for name, value in row.figures.items())
        table.add_row(
            f"{row.what}\n[dim]{figures}[/dim]", row.reference, f"{row.ratio:.2f}", aim, met
        )
    console.print(table)


def run_part(measure: Callable[[bool], list[Row]]) -> None:
    """Run a part with the command's arguments: `[short] [out=FILE]`."""
    rows = measure("short" in sys.argv[1:])
    out = [one.removeprefix("out=") for one in sys.argv[1:] if one.startswith("out=")]
    if out:
        Path(out[0]).write_text(json.dumps([asdict(row) for row in rows]))
    else:
        print_rows(rows, make_console())

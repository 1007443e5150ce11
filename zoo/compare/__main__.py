"""`drivezoo compare A B [key=value ...]`: compare two results of the benchmark.

Pairs the drives of both on the same roads. Prints which one drives better, with intervals over
roads and training seeds, and how many training seeds would be needed to tell.
"""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from zoo.base.written_files import check_output
from zoo.cli.closing_lines import print_written
from zoo.cli.command import Command
from zoo.cli.run_command import run_command

if TYPE_CHECKING:
    from zoo.compare.comparison import ComparedEntries

RESULT = "result.json of a benchmark, or its folder"
COMMAND = Command(__doc__, {"A": RESULT, "B": RESULT})


@dataclass(frozen=True, kw_only=True)
class CompareOptions:
    """Options of a comparison; `conf/compare.yaml` has their meanings and defaults."""

    out: str
    table: str | None
    columns: str | None
    plot: str | None


def compare(
    first: str | Path, second: str | Path, options: CompareOptions
) -> "tuple[ComparedEntries, list[Path]]":
    """Compare two results; return the comparison and the files written.

    Raises:
        InputError: a result cannot be read, the results are of different roads, or a file cannot
            be written.
    """
    from zoo.benchmark.result import NAME
    from zoo.compare.comparison import COLUMNS, ComparedEntries
    from zoo.runs.table_files import check_plot, check_table, write_asked

    check_table(options.table, options.columns, COLUMNS)
    check_plot(options.plot)
    out = Path(options.out).expanduser()
    given = [Path(one).expanduser() for one in (first, second)]
    check_output(out, inputs=[*given, *(one / NAME for one in given)])
    result = ComparedEntries.read(first, second)
    return result, [
        result.write(out),
        *write_asked(result, options.table, options.plot, options.columns),
    ]


def command(arguments: list[str]) -> None:
    """Read the arguments, compare two results and print the comparison."""
    (first, second), options = COMMAND.read(arguments, CompareOptions)
    from rich.console import Console

    from zoo.compare.comparison import print_comparison

    result, written = compare(first, second, options)
    console = Console(emoji=False)
    print_comparison(result, console)
    print_written(written, console=console)


if __name__ == "__main__":
    sys.exit(run_command("zoo.compare", command, sys.argv[1:]))

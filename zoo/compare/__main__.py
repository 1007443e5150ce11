"""`python -m zoo.compare A B [key=value ...]`: compare two results of the benchmark.

Pairs the drives of both on the same roads. Prints which one drives better, with intervals over
roads and training seeds, and how many training seeds would be needed to tell.
"""

import sys
from dataclasses import asdict, dataclass
from pathlib import Path

from datamodules.errors import InputError
from zoo.cli.closing_lines import print_written
from zoo.cli.command import Command
from zoo.cli.run_command import run_command

RESULT = "result.json of a benchmark, or its folder"
COMMAND = Command(__doc__, {"A": RESULT, "B": RESULT})
VERSION = 1  # of the JSON file


@dataclass(frozen=True, kw_only=True)
class CompareOptions:
    """Options of a comparison; `conf/compare.yaml` has their meanings and defaults."""

    out: str


def compare(arguments: list[str]) -> None:
    """Compare two results, print the comparison and write it as JSON.

    Raises:
        InputError: a result cannot be read, the results are of different roads, or the file cannot
            be written.
    """
    (first, second), options = COMMAND.read(arguments, CompareOptions)
    from rich.console import Console

    from zoo.compare.comparison_table import print_comparison
    from zoo.compare.differences import compare_entries
    from zoo.compare.paired_drives import read_pair
    from zoo.runs.whole_file import json_text, write_whole

    a, b = read_pair(Path(first).expanduser(), Path(second).expanduser())
    comparisons = compare_entries(a, b)
    console = Console(emoji=False)
    print_comparison(a, b, comparisons, console)
    out = Path(options.out).expanduser()
    written = {
        "version": VERSION,
        "suite": a.result.suite,
        "roads": a.result.roads,
        "a": {"entry": a.result.entry, "training_seeds": a.seeds},
        "b": {"entry": b.result.entry, "training_seeds": b.seeds},
        "groups": {name: asdict(one) for name, one in comparisons.items()},
    }
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        write_whole(out, json_text(written))
    except OSError as error:
        raise InputError(f"out={out}: {error.strerror}; name another file") from None
    print_written([out], console=console)


if __name__ == "__main__":
    sys.exit(run_command("zoo.compare", compare, sys.argv[1:]))

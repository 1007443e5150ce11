"""Functions of the measurements that the manual's pages quote: their commands and tables."""

import sys
from collections.abc import Callable, Sequence
from inspect import signature
from pathlib import Path

from rich.console import Console
from rich.table import Table


def make_console() -> Console:
    """Return a console; without a terminal it is wide enough for tables."""
    console = Console(emoji=False)
    return console if console.is_terminal else Console(width=140, emoji=False)


def print_table(head: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    """Print a table; numbers as they are."""
    table = Table(*head)
    for row in rows:
        table.add_row(*map(str, row))
    make_console().print(table)


def run_named(*measurements: Callable[..., object]) -> None:
    """Call what `python FILE NAME [argument ...] [key=value ...]` names, with its words as text."""
    by_name = {measure.__name__: measure for measure in measurements}
    name, *words = sys.argv[1:] or [""]
    if name not in by_name:
        sys.exit(f"{Path(sys.argv[0]).name}: name one of {', '.join(by_name)}")
    keys = dict(word.split("=", 1) for word in words if "=" in word)
    try:
        given = signature(by_name[name]).bind(*(word for word in words if "=" not in word), **keys)
    except TypeError as error:
        sys.exit(f"{name}: {error}")
    sys.exit(by_name[name](*given.args, **given.kwargs))

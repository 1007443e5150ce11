"""Functions of the measurements and studies that the manual quotes: commands and tables."""

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

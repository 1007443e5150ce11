"""Functions of the measurements and studies that the manual quotes: commands, tables, CSV files."""

import csv
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from inspect import signature
from pathlib import Path

from rich.console import Console
from rich.table import Table

Row = Mapping[str, str]  # of a study's CSV file, all as text
Rows = Sequence[Row]


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


def grouped(rows: Iterable[Row], keys: Sequence[str]) -> list[list[Row]]:
    """Return rows with the same values of some columns together, in the order of the first."""
    groups: dict[tuple[str, ...], list[Row]] = {}
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
    """Write rows with the same keys as a CSV file; the keys of the first are its header."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def merge(
    old: Rows, new: Rows, key: Sequence[str], same: Sequence[str] = (), sort: Sequence[str] = ()
) -> list[Row]:
    """Return rows with new ones in place of those with the same key, and further ones at the end.

    Args:
        old: rows of the file.
        new: rows that were measured, with values of any type.
        key: columns that tell rows apart.
        same: columns in which all rows must agree; others of `old` are left out.
        sort: columns by whose text the rows are sorted.
    """
    rows = {
        tuple(row[name] for name in key): row
        for row in old
        if all(row[name] == str(new[0][name]) for name in same)
    }
    rows |= {tuple(str(row[name]) for name in key): row for row in new}
    return sorted(rows.values(), key=lambda row: [str(row[name]) for name in sort])

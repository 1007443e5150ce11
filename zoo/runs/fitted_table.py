"""Table for a terminal; columns of figures that do not fit are left out."""

import re
from collections.abc import Iterable, Sequence

from rich.cells import cell_len
from rich.table import Table
from rich.text import Text

from zoo.runs.table import Column

LEAST = 8  # least width of a column of names, in characters
LONGEST_WORD = 16  # a longer word is broken
ENOUGH = 14  # its width before less important figures are shown
FRAME = 3  # width of a column's border and padding


def width_of(column: Column) -> int:
    """Return the width of a column's longest line."""
    return _widest(line for text in _texts(column) for line in text.splitlines())


def least_width(column: Column) -> int:
    """Return the width that breaks no word, or `LONGEST_WORD` if one is longer."""
    return min(_widest(word for text in _texts(column) for word in _words(text)), LONGEST_WORD)


def _texts(column: Column) -> Sequence[str]:
    return column.heading, *column.cells


def wrapped(text: str, width: int) -> str:
    r"""Return a text with line breaks after `/`, `,`, `=` and blanks.

    Lines are at most `width` long, except those of a longer word.

    >>> wrapped("2026-11-21/10-00-01, my_lenet", 12)
    '2026-11-21/\n10-00-01,\nmy_lenet'
    """
    lines = [""]
    for word in _words(text):
        if lines[-1].endswith("\n") or cell_len((lines[-1] + word).rstrip()) > width:
            lines.append("")
        lines[-1] += word
    return "\n".join(line.rstrip() for line in lines if line)


def _words(text: str) -> list[str]:
    return re.findall(r"[^\s/,=]*[/,=]*\s*", text)[:-1]  # the last one is empty


def _widest(texts: Iterable[str]) -> int:
    return max((cell_len(one.rstrip()) for one in texts), default=0)


def fits(columns: Sequence[Column], least: int, width: int) -> bool:
    """Return whether a table of columns, each cut to `least`, is no wider than `width`."""
    return sum(min(width_of(one), least) for one in columns) + FRAME * len(columns) < width


def fitted_table(
    title: str, names: Sequence[Column], figures: Sequence[Column], width: int, first: int = 1
) -> tuple[Table, list[Column]]:
    """Return a table of at most `width`, and the figures that are left out of it.

    Args:
        title: title above the table.
        names: columns that identify the rows; long names fold, no such column is left out.
        figures: columns of numbers, the most important first.
        width: width of the terminal in characters.
        first: number of figures that are shown even if each name gets only `LEAST` characters.
    """
    chosen: list[Column] = []
    left_out: list[Column] = []
    for number, figure in enumerate(figures):
        room = width - sum(width_of(one) + FRAME for one in [*chosen, figure])
        least = LEAST if number < first else max(ENOUGH, *(least_width(one) for one in names))
        has_room = fits(names, least, room)
        (chosen if has_room else left_out).append(figure)
    widths = _widths(names, width - sum(width_of(one) + FRAME for one in chosen))
    table = Table(title=Text(title, style="table.title"), title_justify="left")
    for column, wide in zip(names, widths, strict=True):
        table.add_column(
            Text(wrapped(column.heading, wide)),
            justify="left" if column.heading else "right",  # the number of the row has none
            overflow="fold",
            width=wide,
        )
    for column in chosen:
        table.add_column(Text(column.heading), justify="right", width=width_of(column))
    shown = [
        tuple(wrapped(cell, wide) for cell in column.cells)
        for column, wide in zip(names, widths, strict=True)
    ]
    shown += [tuple(column.cells) for column in chosen]
    for place, cells in enumerate(zip(*shown, strict=True)):
        table.add_row(*map(Text, cells), style=None if place else "bold")
    return table, left_out


def _widths(columns: Sequence[Column], width: int) -> list[int]:
    """Return the columns' widths in characters, which share `width`; the narrowest grow first.

    Words are broken only where all columns together have too little room for whole ones, in the
    widest columns.
    """
    widths = [min(width_of(one), max(least_width(one), LEAST)) for one in columns]
    room = width - 1 - FRAME * len(columns) - sum(widths)
    while room < 0 and max(widths) > LEAST:
        widths[widths.index(max(widths))] -= 1
        room += 1
    while room > 0:
        short = [n for n, one in enumerate(columns) if widths[n] < width_of(one)]
        if not short:
            break
        widths[min(short, key=lambda n: widths[n])] += 1
        room -= 1
    return widths

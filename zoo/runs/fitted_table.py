"""Table for a terminal; columns of figures that do not fit are left out."""

from collections.abc import Sequence

from rich.cells import cell_len
from rich.table import Table
from rich.text import Text

from zoo.runs.result_table import Column

ENOUGH = 14  # least width of a column of longer names before a further figure is shown
FRAME = 3  # width of a column's border and padding


def fitted_table(
    title: str, names: Sequence[Column], figures: Sequence[Column], width: int, first: int = 1
) -> tuple[Table, list[Column]]:
    """Return a table of at most `width`, and the figures that are left out of it.

    Args:
        title: title above the table.
        names: columns that identify the rows; long names fold, no such column is left out.
        figures: columns of numbers, the most important first.
        width: width of the terminal in characters.
        first: number of figures that are shown in any case.
    """
    room = width - 1 - sum(min(_width(name), ENOUGH) + FRAME for name in names)
    shown: list[Column] = []
    left_out: list[Column] = []
    for number, figure in enumerate(figures):
        fits = number < first or _width(figure) + FRAME <= room
        (shown if fits else left_out).append(figure)
        room -= _width(figure) + FRAME if fits else 0
    table = Table(title=Text(title, style="table.title"), title_justify="left")
    for column in names:  # the number of the row has no heading
        heading = column.heading
        table.add_column(Text(heading), justify="left" if heading else "right", overflow="fold")
    for column in shown:
        table.add_column(Text(column.heading), justify="right", no_wrap=True)
    columns = (column.cells for column in [*names, *shown])
    for number, cells in enumerate(zip(*columns, strict=True)):
        table.add_row(*map(Text, cells), style=None if number else "bold")
    return table, left_out


def _width(column: Column) -> int:
    """Return the width of a column's longest line."""
    return max(
        cell_len(line) for text in (column.heading, *column.cells) for line in text.split("\n")
    )

"""Tables of results: rounded texts for people, unrounded figures for programs."""

import math
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from zoo.base.errors import UsageError, hint
from zoo.base.file_text import csv_text, html_text, markdown_cell, tex_text

if TYPE_CHECKING:
    import rich.table

Cell = str | int | float | bool | None
ENOUGH = 14  # least width of a column of longer names before a further figure is shown
FRAME = 3  # width of a column's border and padding


@dataclass(frozen=True)
class Column:
    """A column of a table, as printed texts and as figures.

    Attributes:
        name: name in `columns=`.
        heading: printed heading.
        cells: printed texts, rounded, with their intervals or deviations.
        figures: unrounded figures by name, one column of a CSV file each; None where there is no
            figure. Empty for the texts themselves, under `name`.
        short: whether a TeX table has the column if `columns=` names none.
    """

    name: str
    heading: str
    cells: Sequence[str]
    figures: Mapping[str, Sequence[Cell]] = field(default_factory=dict)
    short: bool = True

    @property
    def by_name(self) -> Mapping[str, Sequence[Cell]]:
        """Return the figures by name, or the texts where there are none."""
        return self.figures or {self.name: self.cells}


@dataclass(frozen=True)
class Table:
    """A table of results.

    Attributes:
        columns: columns of the same number of rows.
        caption: what the rows are, and what an interval or a deviation is, for TeX.
    """

    columns: Sequence[Column]
    caption: str = ""

    @classmethod
    def of(
        cls, headings: Sequence[str], rows: Sequence[Sequence[str]], caption: str = ""
    ) -> "Table":
        """Return a table of texts."""
        cells = ([row[number] for row in rows] for number in range(len(headings)))
        return cls([Column(*row) for row in zip(headings, headings, cells, strict=True)], caption)

    @classmethod
    def of_figures(cls, rows: Iterable[Mapping[str, Cell]]) -> "Table":
        """Return rows of figures as a table whose printed numbers have four digits.

        >>> Table.of_figures([{"network": "lenet", "autonomy": 0.98765}, {"network": None}]).cells
        [('lenet', '0.9877'), ('-', '-')]
        """
        rows, columns = [{str(name): cell for name, cell in row.items()} for row in rows], []
        for name in dict.fromkeys(name for row in rows for name in row):
            # NaN is no figure.
            values = [None if (cell := row.get(name)) != cell else cell for row in rows]
            columns.append(Column(name, name, list(map(_text, values)), {name: values}))
        return cls(columns)

    @property
    def rows(self) -> list[dict[str, Cell]]:
        """Return the rows as figures by name, unrounded; None where there is no figure."""
        names, values = self.figures, self.figures.values()
        return [dict(zip(names, row, strict=True)) for row in zip(*values, strict=True)]

    @property
    def figures(self) -> dict[str, Sequence[Cell]]:
        """Return the unrounded figures of all columns by name."""
        return {name: values for column in self.columns for name, values in column.by_name.items()}

    @property
    def headings(self) -> list[str]:
        """Return the printed headings."""
        return [column.heading for column in self.columns]

    @property
    def cells(self) -> list[tuple[str, ...]]:
        """Return the rows as printed texts."""
        return list(zip(*(column.cells for column in self.columns), strict=True))

    def short(self) -> "Table":
        """Return the table of the columns that TeX shows by default."""
        return replace(self, columns=[column for column in self.columns if column.short])

    def chosen(self, columns: str) -> "Table":
        """Return the table of the columns that a user names, in the named order.

        Raises:
            UsageError: there is no such column.
        """
        by_name = {column.name: column for column in self.columns}
        return replace(self, columns=[by_name[name] for name in column_names(columns, by_name)])

    def turned(self) -> "Table":
        """Return the table with a column for each row, and the headings as its first column."""
        first, *others = self.columns
        headings = [column.heading for column in others]
        return Table.of(
            [first.heading, *first.cells],
            [[heading, *column.cells] for heading, column in zip(headings, others, strict=True)],
            self.caption,
        )

    def narrow(self) -> "Table":
        """Return the table with a second line for intervals and deviations, but in column 0."""
        first, *others = self.columns
        others = [replace(column, cells=list(map(two_lines, column.cells))) for column in others]
        return replace(self, columns=[first, *others])

    def printed(
        self, left: int | None = None, whole: Iterable[int] = (), **style: Any
    ) -> "rich.table.Table":
        """Return the table for a terminal; no text is read as markup.

        Args:
            left: number of first columns aligned to the left; None for all.
            whole: numbers of columns whose lines are not broken.
            **style: arguments of `rich.table.Table`, such as title and box.
        """
        from rich.table import Table as Printed
        from rich.text import Text

        shown = Printed(**style)
        for number, heading in enumerate(self.headings):
            side: Any = "left" if left is None or number < left else "right"
            breaks: dict[str, Any] = {"no_wrap": True} if number in whole else {"overflow": "fold"}
            shown.add_column(Text(heading), justify=side, **breaks)
        for row in self.cells:
            shown.add_row(*map(Text, row))
        return shown

    def csv(self) -> str:
        r"""Return the figures as CSV; an empty cell has no figure.

        >>> Table.of_figures([{"a": 1, "b": 0.1}, {"a": None}]).csv()
        'a,b\n1,0.1\n,\n'
        """
        return csv_text([self.figures, *zip(*self.figures.values(), strict=True)])

    def tex(self) -> str:
        r"""Return the texts for LaTeX in the style of booktabs; with a caption, as a float.

        >>> run = Column("run", "run", ["a_1"])
        >>> autonomy = Column("autonomy", "autonomy", ["98% ± 1%"], {"autonomy": [0.98]})
        >>> print(Table([run, autonomy]).tex())
        % \usepackage{booktabs}
        \begin{tabular}{lr}
        \toprule
        run & autonomy \\
        \midrule
        a\_1 & 98\% $\pm$ 1\% \\
        \bottomrule
        \end{tabular}
        <BLANKLINE>
        """
        head, *rows = (
            " & ".join(map(tex_text, row)) + r" \\" for row in (self.headings, *self.cells)
        )
        kinds = "".join("l" if is_text else "r" for is_text in self._are_texts())
        lines = [rf"\begin{{tabular}}{{{kinds}}}", r"\toprule", head, r"\midrule", *rows]
        lines += [r"\bottomrule", r"\end{tabular}"]
        if self.caption:
            caption = rf"\caption{{{tex_text(self.caption)}}}"
            box = r"\begin{adjustbox}{max width=\linewidth}"  # figures with intervals are wide
            lines = [caption, box, *lines, r"\end{adjustbox}"]
            lines = [r"\begin{table}", r"\centering", *lines, r"\end{table}"]
        packages = "booktabs,adjustbox" if self.caption else "booktabs"
        return "\n".join([rf"% \usepackage{{{packages}}}", *lines, ""])

    def markdown(self, left: int | None = None, bold: Collection[int] = ()) -> str:
        r"""Return the texts as Markdown.

        Args:
            left: number of first columns aligned to the left; None for those of texts.
            bold: numbers of bold rows.

        >>> print(Table.of(["a|b", "n"], [["x_1", "2"]]).markdown(left=1, bold=[0]))
        | a\|b | n |
        | --- | ---: |
        | **x\_1** | **2** |
        """
        numbers = range(len(self.columns))
        are_left = self._are_texts() if left is None else [number < left for number in numbers]
        rule = ["---" if is_left else "---:" for is_left in are_left]
        lines = [map(markdown_cell, self.headings), rule]
        for number, row in enumerate(self.cells):
            mark = "**" if number in bold else ""
            lines.append([f"{mark}{markdown_cell(cell)}{mark}" if cell else "" for cell in row])
        return "\n".join(f"| {' | '.join(line)} |" for line in lines)

    def html(self, caption: str = "") -> str:
        """Return the texts as an element of HTML, which notebooks show."""
        head = "".join(f"<th>{_html(heading)}</th>" for heading in self.headings)
        body = "".join(
            f"<tr>{''.join(f'<td>{_html(cell)}</td>' for cell in row)}</tr>" for row in self.cells
        )
        return (
            f"<table><caption>{_html(caption or self.caption)}</caption>"
            f"<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
        )

    def _are_texts(self) -> list[bool]:
        """Return of each column whether its first figures are texts."""
        firsts = (next(iter(column.by_name.values())) for column in self.columns)
        return [any(isinstance(value, str) for value in values) for values in firsts]


def column_names(columns: str, known: Iterable[str]) -> list[str]:
    """Return the names in `a,b`; raise UsageError for one that is no column, or is there twice."""
    names = [name.strip() for name in columns.split(",")]
    for number, name in enumerate(names):
        if name not in known:
            what = name or "without a name"
            raise UsageError(f"columns={columns}: there is no column {what}; {hint(name, known)}")
        if name in names[:number]:
            raise UsageError(f"columns={columns}: names {name} twice")
    return names


def with_interval(figure: Any, form: str, factor: float = 1) -> str:
    """Return a figure with its interval, both times a factor.

    A figure has `value`, `low` and `high`; None or NaN where one is not known.

    >>> from types import SimpleNamespace as Figure
    >>> with_interval(Figure(value=0.9, low=0.8, high=0.95), "{:.0f}", 100)
    '90 (80 to 95)'
    >>> with_interval(Figure(value=None, low=710.0, high=None), "{:.0f}")
    'none (710 or more)'
    >>> with_interval(Figure(value=math.nan, low=math.nan, high=math.nan), "{:.0f}")
    '-'
    """
    value, low, high = (
        None if number is None else form.format(factor * number)
        for number in map(known, (figure.value, figure.low, figure.high))
    )
    if low is None:
        return value or "-"
    value = value or "none"
    return f"{value} ({low} or more)" if high is None else f"{value} ({low} to {high})"


def two_lines(cell: str) -> str:
    r"""Return a text with its interval or deviation in a second line, for a narrow column.

    >>> two_lines("90 (80 to 95)"), two_lines("none (710 or more)"), two_lines("98.2% ± 0.4%")
    ('90\n80..95', 'none\n>= 710', '98.2%\n± 0.4%')
    >>> two_lines("3 of 3 (95 %: 29 % or more)"), two_lines("plain")
    ('3 of 3 (95 %:\n29 % or more)', 'plain')
    """
    interval = re.fullmatch(r"(.+) \(([^:]+)\)", cell)
    if interval is None:
        return cell.replace(" ±", "\n±").replace(": ", ":\n")
    bounds = re.sub("^(.+) or more$", r">= \1", interval[2]).replace(" to ", "..")
    return f"{interval[1]}\n{bounds}"


def interval_figures(name: str, figures: Sequence[Any]) -> dict[str, list[Cell]]:
    """Return figures as columns of a table: `NAME`, `NAME_low` and `NAME_high`."""
    return {
        name: [known(figure.value) for figure in figures],
        f"{name}_low": [known(figure.low) for figure in figures],
        f"{name}_high": [known(figure.high) for figure in figures],
    }


def interval_column(
    name: str,
    heading: str,
    figures: Sequence[Any],
    form: str,
    factor: float = 1,
    short: bool = True,
) -> Column:
    """Return a column of figures with their intervals; the texts are times a factor."""
    texts = [with_interval(figure, form, factor) for figure in figures]
    return Column(name, heading, texts, interval_figures(name, figures), short)


def number_column(
    name: str, heading: str, numbers: Sequence[Cell], form: str = "{}", short: bool = True
) -> Column:
    """Return a column of numbers, which the texts round; an empty text where there is none."""
    texts = ["" if number is None else form.format(number) for number in numbers]
    return Column(name, heading, texts, {name: numbers}, short)


def known(value: float | None) -> float | None:
    """Return a finite number; None for NaN, an infinite one and None."""
    return value if value is not None and math.isfinite(value) else None


def fitted_table(
    title: str, names: Sequence[Column], figures: Sequence[Column], width: int, first: int = 1
) -> tuple["rich.table.Table", list[Column]]:
    """Return a table for a terminal of at most `width`, and the figures that are left out of it.

    Args:
        title: title above the table.
        names: columns that identify the rows; long names fold, no such column is left out.
        figures: columns of numbers, the most important first.
        width: width of the terminal in characters.
        first: number of figures that are shown in any case.
    """
    from rich.table import Table as Printed
    from rich.text import Text

    room = width - 1 - sum(min(_width(name), ENOUGH) + FRAME for name in names)
    shown: list[Column] = []
    left_out: list[Column] = []
    for number, figure in enumerate(figures):
        fits = number < first or _width(figure) + FRAME <= room
        (shown if fits else left_out).append(figure)
        room -= _width(figure) + FRAME if fits else 0
    table = Printed(title=Text(title, style="table.title"), title_justify="left")
    for heading in Table(names).headings:  # the number of the row has no heading
        table.add_column(Text(heading), justify="left" if heading else "right", overflow="fold")
    for column in shown:
        table.add_column(Text(column.heading), justify="right", no_wrap=True)
    for number, cells in enumerate(Table([*names, *shown]).cells):
        table.add_row(*map(Text, cells), style=None if number else "bold")
    return table, left_out


def _text(value: Cell) -> str:
    if value is None:
        return "-"
    return f"{value:.4g}" if isinstance(value, float | np.floating) else str(value)


def _html(text: str) -> str:
    return escape(html_text(text)).replace("\n", "<br>")


def _width(column: Column) -> int:
    """Return the width of a column's longest line."""
    from rich.cells import cell_len

    return max(
        cell_len(line) for text in (column.heading, *column.cells) for line in text.split("\n")
    )

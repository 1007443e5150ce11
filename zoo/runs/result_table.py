"""Results as tables: rows of figures for programs, and CSV, Parquet and TeX files."""

import csv
import io
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from zoo.base.errors import InputError, UsageError
from zoo.base.terminal import printable
from zoo.base.whole_file import write_output
from zoo.base.written_files import check_output
from zoo.cli.nearest import hint

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TABLES = (".csv", ".tex", ".parquet")
PLOTS = (".pdf", ".svg", ".png")
Cell = str | int | float | bool | None


@dataclass(frozen=True)
class TableColumn:
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
class ResultTable:
    """A table of results.

    Attributes:
        columns: columns of the same number of rows.
        caption: what the rows are, and what an interval or a deviation is, for TeX.
    """

    columns: Sequence[TableColumn]
    caption: str = ""

    @property
    def rows(self) -> list[dict[str, Cell]]:
        """Return the rows as figures by name, unrounded; None where there is no figure."""
        names, values = self.figures, self.figures.values()
        return [dict(zip(names, row, strict=True)) for row in zip(*values, strict=True)]

    @property
    def figures(self) -> dict[str, Sequence[Cell]]:
        """Return the unrounded figures of all columns by name."""
        return {name: one for each in self.columns for name, one in each.by_name.items()}

    @property
    def headings(self) -> list[str]:
        """Return the printed headings."""
        return [one.heading for one in self.columns]

    @property
    def cells(self) -> list[tuple[str, ...]]:
        """Return the rows as printed texts."""
        return list(zip(*(one.cells for one in self.columns), strict=True))

    def short(self) -> "ResultTable":
        """Return the table of the columns that TeX shows by default."""
        return replace(self, columns=[one for one in self.columns if one.short])

    def chosen(self, columns: str) -> "ResultTable":
        """Return the table of the columns that a user names, in the named order.

        Raises:
            UsageError: there is no such column.
        """
        names = [one.strip() for one in columns.split(",")]
        by_name = {one.name: one for one in self.columns}
        check_columns(columns, by_name)
        return replace(self, columns=[by_name[one] for one in names])


class Result(ABC):
    """Base of the objects that hold the results of a command."""

    @abstractmethod
    def result_table(self) -> ResultTable:
        """Return the result as a table."""

    def plot(self) -> "Figure":
        """Return a figure of the result."""
        raise NotImplementedError(f"{type(self).__name__} has no plot")

    def table(self) -> list[dict[str, Cell]]:
        """Return the rows of the table: figures by name, unrounded."""
        return [dict(row) for row in self.result_table().rows]

    def to_pandas(self) -> Any:
        """Return the table as a pandas DataFrame.

        Raises:
            InputError: pandas is not installed.
        """
        try:
            import pandas
        except ImportError:
            raise InputError(
                "pandas is not installed; pip install pandas, or use table()"
            ) from None
        return pandas.DataFrame(self.table())

    def write_table(self, path: str | Path, columns: str | Sequence[str] | None = None) -> Path:
        """Write the table as a .csv, .tex or .parquet file; return its path.

        Args:
            path: file to write.
            columns: names of the columns; None for all, and for the most important in TeX.

        Raises:
            InputError: the file's name has another ending, or it cannot be written.
            UsageError: there is no such column.
        """
        names = columns if isinstance(columns, str | None) else ",".join(columns)
        return write_table(self.result_table(), path, names)

    def _repr_html_(self) -> str:
        """Return the table as HTML, which notebooks show."""
        table = self.result_table().short()
        head = "".join(f"<th>{_html(one)}</th>" for one in table.headings)
        body = "".join(
            f"<tr>{''.join(f'<td>{_html(one)}</td>' for one in row)}</tr>" for row in table.cells
        )
        return (
            f"<table><caption>{_html(repr(self))}</caption>"
            f"<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
        )


def check_table(
    path: str | Path | None, columns: str | None = None, known: Iterable[str] = ()
) -> None:
    """Raise InputError for a table's file that cannot be written; call before long work.

    Args:
        path: file of the table; None for no table.
        columns: names of its columns, with commas between them.
        known: names that the table has; none where they depend on what the work finds.
    """
    if path is None:
        if columns is not None:
            raise UsageError(f"columns={columns}: are those of table=FILE; name the file, too")
        return
    if columns is not None and known:
        check_columns(columns, known)
    check_ending(path, TABLES, "table")
    if Path(path).suffix == ".parquet":
        _pyarrow(path)


def check_columns(columns: str, known: Iterable[str]) -> None:
    """Raise UsageError for a name that is no column, or is there twice."""
    names = [one.strip() for one in columns.split(",")]
    for place, name in enumerate(names):
        if name not in known:
            raise UsageError(f"columns={columns}: there is no column {name}; {hint(name, known)}")
        if name in names[:place]:
            raise UsageError(f"columns={columns}: names {name} twice")


def check_plot(path: str | Path | None, key: str = "plot") -> None:
    """Raise UsageError for a plot's file that is neither PDF, SVG nor PNG."""
    if path is not None:
        check_ending(path, PLOTS, key)


def check_ending(path: str | Path, endings: Sequence[str], key: str) -> None:
    """Raise UsageError for a file whose name has another ending, or that is a folder."""
    if Path(path).suffix not in endings:
        raise UsageError(f"{key}={path}: must end in {', '.join(endings[:-1])} or {endings[-1]}")
    if Path(path).expanduser().is_dir():
        raise UsageError(f"{key}={path}: is a folder; name a file")
    check_output(Path(path).expanduser(), key)


def write_table(table: ResultTable, path: str | Path, columns: str | None = None) -> Path:
    """Write a table as a .csv, .tex or .parquet file; return its path.

    CSV and Parquet have the unrounded figures, TeX the printed texts of the most important columns;
    `columns` names others, with commas between them.

    Raises:
        InputError: the file's name has another ending, or it cannot be written.
        UsageError: there is no such column.
    """
    check_table(path)
    path = Path(path).expanduser()
    forms: dict[str, Callable[[ResultTable], str | bytes]] = {
        ".csv": csv_text,
        ".tex": tex_text,
        ".parquet": parquet_bytes,
    }
    if columns is not None:
        table = table.chosen(columns)
    elif path.suffix == ".tex":
        table = table.short()
    return write_output(path, forms[path.suffix](table), "table")


def write_plot(figure: "Figure", path: str | Path) -> Path:
    """Write a figure as a .pdf, .svg or .png file; return its path.

    Raises:
        InputError: the file's name has another ending, or it cannot be written.
    """
    check_plot(path)
    path = Path(path).expanduser()
    contents = io.BytesIO()
    figure.savefig(contents, dpi=200, format=path.suffix[1:])
    return write_output(path, contents.getvalue(), "plot")


def write_asked(
    result: Result, table: str | None, plot: str | None = None, columns: str | None = None
) -> list[Path]:
    """Write the table and the plot that the user asks for; return their paths."""
    written = [] if table is None else [result.write_table(table, columns)]
    if plot is not None:
        written.append(write_plot(result.plot(), plot))
    return written


def table_of(rows: Sequence[Mapping[str, Cell]]) -> ResultTable:
    """Return rows of figures as a table whose printed numbers have four digits.

    >>> table_of([{"network": "lenet", "autonomy": 0.98765}, {"network": None}]).cells
    [('lenet', '0.9877'), ('-', '-')]
    """
    columns = []
    for name in dict.fromkeys(name for row in rows for name in row):
        values = [row.get(name) for row in rows]
        columns.append(TableColumn(name, name, list(map(_text, values)), {name: values}))
    return ResultTable(columns)


def csv_text(table: ResultTable) -> str:
    r"""Return a table as CSV; an empty cell has no figure.

    >>> csv_text(table_of([{"a": 1, "b": 0.1}, {"a": None}]))
    'a,b\n1,0.1\n,\n'
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerows([table.figures, *zip(*table.figures.values(), strict=True)])
    return text.getvalue()


def tex_text(table: ResultTable) -> str:
    r"""Return a table for LaTeX in the style of booktabs; with a caption, as a float.

    >>> run = TableColumn("run", "run", ["a_1"])
    >>> autonomy = TableColumn("autonomy", "autonomy", ["98% ± 1%"], {"autonomy": [0.98]})
    >>> print(tex_text(ResultTable([run, autonomy])))
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
    lines = [" & ".join(map(tex_escape, row)) + r" \\" for row in (table.headings, *table.cells)]
    above, below = [], []
    if table.caption:
        above = [r"\begin{table}", r"\centering", rf"\caption{{{tex_escape(table.caption)}}}"]
        below = [r"\end{table}"]
    parts = [
        r"% \usepackage{booktabs}",
        *above,
        rf"\begin{{tabular}}{{{''.join(map(_alignment, table.columns))}}}",
        r"\toprule",
        lines[0],
        r"\midrule",
        *lines[1:],
        r"\bottomrule",
        r"\end{tabular}",
        *below,
    ]
    return "\n".join(parts) + "\n"


def _alignment(column: TableColumn) -> str:
    """Return `l` for texts, `r` for numbers."""
    return "l" if any(isinstance(one, str) for one in next(iter(column.by_name.values()))) else "r"


_TEX = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "±": r"$\pm$",
    "-": "$-$",
    ">=": r"$\geq$",
    "<=": r"$\leq$",
    **{one: f"${one}$" for one in "<>|"},
    **{one: f"\\{one}" for one in "&%$#_{}"},
}


def tex_escape(text: str) -> str:
    r"""Return a text for LaTeX, in one line.

    >>> tex_escape("50_% >= {x}"), tex_escape("-1 to 2, 2026-01-02")
    ('50\\_\\% $\\geq$ \\{x\\}', '$-$1 to 2, 2026-01-02')
    """
    special = r"[<>]=|[\\~^±<>|&%$#_{}]|(?<![\w-])-(?=\d)"
    return re.sub(special, lambda one: _TEX[one[0]], " ".join(text.split()))


def parquet_bytes(table: ResultTable) -> bytes:
    """Return a table as a Parquet file."""
    pyarrow = _pyarrow("table")
    columns = {name: list(one) for name, one in table.figures.items()}
    contents = io.BytesIO()
    pyarrow.parquet.write_table(pyarrow.table(columns), contents)
    return contents.getvalue()


def _pyarrow(path: str | Path) -> Any:
    try:
        import pyarrow.parquet
    except ImportError:
        raise InputError(
            f"{path}: Parquet needs pyarrow; pip install 'drivezoo[parquet]', or name a .csv file"
        ) from None
    return pyarrow


def _text(value: Cell) -> str:
    if value is None:
        return "-"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _html(text: str) -> str:
    return escape(printable(text)).replace("\\n", "<br>")

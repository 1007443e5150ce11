"""Results as tables: rows of figures for programs, and CSV, Parquet and TeX files."""

import csv
import io
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from datamodules.errors import InputError, UsageError
from datamodules.terminal import printable
from zoo.runs.whole_file import write_whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TABLES = (".csv", ".tex", ".parquet")
PLOTS = (".pdf", ".svg", ".png")
Cell = str | int | float | bool | None


@dataclass(frozen=True)
class ResultTable:
    """A table of results in two forms.

    Attributes:
        rows: figures by name, unrounded; None where there is no figure.
        headings: headings of the printed columns.
        cells: printed texts of each row, rounded, with their intervals or deviations.
    """

    rows: Sequence[Mapping[str, Cell]]
    headings: Sequence[str]
    cells: Sequence[Sequence[str]]


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

    def write_table(self, path: str | Path) -> Path:
        """Write the table as a .csv, .tex or .parquet file; return its path.

        Raises:
            InputError: the file's name has another ending, or it cannot be written.
        """
        return write_table(self.result_table(), path)

    def _repr_html_(self) -> str:
        """Return the table as HTML, which notebooks show."""
        table = self.result_table()
        head = "".join(f"<th>{_html(one)}</th>" for one in table.headings)
        body = "".join(
            f"<tr>{''.join(f'<td>{_html(one)}</td>' for one in row)}</tr>" for row in table.cells
        )
        return (
            f"<table><caption>{_html(repr(self))}</caption>"
            f"<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
        )


def check_table(path: str | Path | None, key: str = "table") -> None:
    """Raise InputError for a table's file that cannot be written; call before long work."""
    if path is None:
        return
    check_ending(path, TABLES, key)
    if Path(path).suffix == ".parquet":
        _pyarrow(path)


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


def write_table(table: ResultTable, path: str | Path) -> Path:
    """Write a table as a .csv, .tex or .parquet file; return its path.

    CSV and Parquet have the unrounded figures; TeX has the printed texts.

    Raises:
        InputError: the file's name has another ending, or it cannot be written.
    """
    check_table(path)
    path = Path(path).expanduser()
    forms: dict[str, Callable[[ResultTable], str | bytes]] = {
        ".csv": csv_text,
        ".tex": tex_text,
        ".parquet": parquet_bytes,
    }
    return _write(path, forms[path.suffix](table), "table")


def write_plot(figure: "Figure", path: str | Path) -> Path:
    """Write a figure as a .pdf, .svg or .png file; return its path.

    Raises:
        InputError: the file's name has another ending, or it cannot be written.
    """
    check_plot(path)
    path = Path(path).expanduser()
    contents = io.BytesIO()
    figure.savefig(contents, dpi=200, format=path.suffix[1:])
    return _write(path, contents.getvalue(), "plot")


def write_asked(result: Result, table: str | None, plot: str | None = None) -> list[Path]:
    """Write the table and the plot that the user asks for; return their paths."""
    written = [] if table is None else [result.write_table(table)]
    if plot is not None:
        written.append(write_plot(result.plot(), plot))
    return written


def table_of(rows: Sequence[Mapping[str, Cell]]) -> ResultTable:
    """Return rows of figures as a table whose printed numbers have four digits.

    >>> table_of([{"network": "lenet", "autonomy": 0.98765}, {"network": None}]).cells
    [['lenet', '0.9877'], ['-', '-']]
    """
    headings = columns_of(rows)
    cells = [[_text(row.get(name)) for name in headings] for row in rows]
    return ResultTable(rows, headings, cells)


def columns_of(rows: Sequence[Mapping[str, Cell]]) -> list[str]:
    """Return the names of all rows' figures, in order."""
    return list(dict.fromkeys(name for row in rows for name in row))


def csv_text(table: ResultTable) -> str:
    r"""Return a table as CSV; an empty cell has no figure.

    >>> csv_text(ResultTable([{"a": 1, "b": 0.1}, {"a": None}], [], []))
    'a,b\n1,0.1\n,\n'
    """
    text = io.StringIO()
    writer = csv.DictWriter(text, columns_of(table.rows), restval=None, lineterminator="\n")
    writer.writeheader()
    writer.writerows(table.rows)
    return text.getvalue()


def tex_text(table: ResultTable) -> str:
    r"""Return a table as a LaTeX tabular in the style of booktabs.

    >>> print(tex_text(ResultTable([], ["run", "autonomy"], [["a_1", "98% ± 1%"]])))
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
    columns = "l" + "r" * (len(table.headings) - 1)
    parts = [
        r"% \usepackage{booktabs}",
        rf"\begin{{tabular}}{{{columns}}}",
        r"\toprule",
        lines[0],
        r"\midrule",
        *lines[1:],
        r"\bottomrule",
        r"\end{tabular}",
    ]
    return "\n".join(parts) + "\n"


_TEX = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "±": r"$\pm$",
    **{one: f"${one}$" for one in "<>|"},
    **{one: f"\\{one}" for one in "&%$#_{}"},
}


def tex_escape(text: str) -> str:
    r"""Return a text for LaTeX, in one line.

    >>> tex_escape("50_% >= {x}")
    '50\\_\\% $>$= \\{x\\}'
    """
    return re.sub(r"[\\~^±<>|&%$#_{}]", lambda one: _TEX[one[0]], " ".join(text.split()))


def parquet_bytes(table: ResultTable) -> bytes:
    """Return a table as a Parquet file."""
    pyarrow = _pyarrow("table")
    names = columns_of(table.rows)
    columns = {name: [row.get(name) for row in table.rows] for name in names}
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


def _write(path: Path, contents: str | bytes, key: str) -> Path:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        return write_whole(path, contents)
    except OSError as error:
        raise InputError(f"{key}={path}: {error.strerror}; name another file") from None


def _text(value: Cell) -> str:
    if value is None:
        return "-"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _html(text: str) -> str:
    return escape(printable(text)).replace("\\n", "<br>")

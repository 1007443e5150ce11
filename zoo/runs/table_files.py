"""Results as files: a table as CSV, TeX, Parquet, Markdown or HTML, a plot as PDF, SVG or PNG."""

import io
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from zoo.base.command import Shown
from zoo.base.errors import UsageError, library_errors, optional_import
from zoo.base.key_values import convert
from zoo.base.output_files import checked_file, overwriting
from zoo.base.terminal import printable
from zoo.base.whole_file import write_output
from zoo.runs.result_table import Cell, Table, column_names

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PLOTS = (".pdf", ".svg", ".png")


class Result(Shown, ABC):
    """Base of the objects that hold the results of a command."""

    @abstractmethod
    def result_table(self) -> Table:
        """Return the result as a table."""

    def plot(self) -> "Figure":
        """Return a figure of the result."""
        raise NotImplementedError(f"{type(self).__name__} has no plot")

    def table(self) -> list[dict[str, Cell]]:
        """Return the rows of the table: figures by name, unrounded."""
        return self.result_table().rows

    def to_pandas(self) -> Any:
        """Return the table as a pandas DataFrame.

        Raises:
            InputError: pandas is not installed.
        """
        with optional_import("pandas is not installed; pip install pandas, or use table()"):
            import pandas
        return pandas.DataFrame(self.table())

    def write_table(
        self,
        path: str | Path,
        columns: str | Sequence[str] | None = None,
        overwrite: bool = False,
    ) -> Path:
        """Write the table as a file, see `write_table`; return its path.

        Args:
            path: file to write.
            columns: names of the columns; None for all, and for the most important in TeX.
            overwrite: whether an existing file is replaced.

        Raises:
            InputError: the file's name has another ending, or it cannot be written.
            UsageError: there is no such column, or the file exists.
        """
        names = columns if isinstance(columns, str | None) else ",".join(columns)
        with overwriting(convert("overwrite", bool, overwrite)):
            return write_table(self.result_table(), path, names)

    def _repr_html_(self) -> str:
        """Return the table as HTML, which notebooks show."""
        return self.result_table().short().html(repr(self))


@dataclass(frozen=True, kw_only=True)
class TableFiles:
    """Keys of a command that writes its table.

    Args:
        table: file to write the table to: .csv, .tex, .parquet, .md or .html.
        columns: names of the table's columns, such as a,b; null: all, in .tex the main ones.
    """

    table: str | None = None
    columns: str | None = None

    def check_files(self, known: Iterable[str] = (), inputs: Sequence[str | Path] = ()) -> None:
        """Raise InputError for files that cannot be written; call before long work.

        Args:
            known: names of the table's columns; none where they depend on what the work finds.
            inputs: files and folders that the command reads.
        """
        if self.table is not None:
            _checked_table(self.table, inputs)
        elif self.columns is not None:
            raise UsageError(f"columns={self.columns}: are those of table=FILE; name the file, too")
        if self.columns is not None and known:
            column_names(self.columns, known)

    def write_files(self, result: Result | Table) -> list[Path]:
        """Write the files that the user named; return their paths."""
        table = result if isinstance(result, Table) else result.result_table()
        return [] if self.table is None else [write_table(table, self.table, self.columns)]


@dataclass(frozen=True, kw_only=True)
class ResultFiles(TableFiles):
    """Keys of a command that writes its table and plots its result.

    Args:
        plot: file to draw the result in: .pdf, .svg or .png.
    """

    plot: str | None = None

    def check_files(self, known: Iterable[str] = (), inputs: Sequence[str | Path] = ()) -> None:
        """Raise InputError for files that cannot be written; see `TableFiles`."""
        super().check_files(known, inputs)
        if self.plot is not None:
            checked_file(self.plot, PLOTS, "plot", inputs)

    def write_files(self, result: Result | Table) -> list[Path]:
        """Write the files that the user named; return their paths."""
        written = super().write_files(result)
        if self.plot is not None and isinstance(result, Result):
            written.append(write_plot(result.plot(), self.plot))
        return written


def _checked_table(path: str | Path, inputs: Sequence[str | Path] = ()) -> Path:
    path = checked_file(path, FORMS, "table", inputs)
    if path.suffix == ".parquet":
        _pyarrow(path)
    return path


def write_table(table: Table, path: str | Path, columns: str | None = None) -> Path:
    """Write a table as a file whose ending is one of `FORMS`; return its path.

    CSV and Parquet have the unrounded figures, the others the printed texts; TeX has only the most
    important columns. `columns` names others, with commas between them.

    Raises:
        InputError: the file's name has another ending, or it cannot be written.
        UsageError: there is no such column.
    """
    path = _checked_table(path)
    if columns is not None:
        table = table.chosen(columns)
    elif path.suffix == ".tex":
        table = table.short()
    return write_output(path, FORMS[path.suffix](table), "table")


def write_plot(figure: "Figure", path: str | Path) -> Path:
    """Write a figure as a .pdf, .svg or .png file; return its path.

    Raises:
        InputError: the file's name has another ending, or it cannot be written.
    """
    path = checked_file(path, PLOTS, "plot")
    from matplotlib import rc_context

    contents = io.BytesIO()
    with rc_context({"pdf.fonttype": 42}):  # venues refuse fonts of Type 3
        figure.savefig(contents, dpi=200, format=path.suffix[1:])
    return write_output(path, contents.getvalue(), "plot")


def parquet_bytes(table: Table) -> bytes:
    """Return the figures of a table as a Parquet file."""
    pyarrow = _pyarrow("table")
    # A name of a folder may hold bytes that are not UTF-8.
    columns = {
        name: [printable(value) if isinstance(value, str) else value for value in values]
        for name, values in table.figures.items()
    }
    contents = io.BytesIO()
    with library_errors("table", "Parquet takes one kind in a column", "name a .csv file"):
        pyarrow.parquet.write_table(pyarrow.table(columns), contents)
    return contents.getvalue()


def _pyarrow(path: str | Path) -> Any:
    remedy = 'pip install "drivezoo[parquet]", or name a .csv file'
    with optional_import(f"{path}: Parquet needs pyarrow; {remedy}"):
        import pyarrow.parquet
    return pyarrow


FORMS: dict[str, Callable[[Table], str | bytes]] = {
    ".csv": Table.csv,
    ".tex": Table.tex,
    ".parquet": parquet_bytes,
    ".md": lambda table: table.markdown() + "\n",
    ".html": lambda table: f'<!doctype html>\n<meta charset="utf-8">\n{table.html()}\n',
}

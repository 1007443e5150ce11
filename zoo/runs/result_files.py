"""Keys of the commands that write tables and plots of their results."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class TableFiles:
    """Keys of a command that writes its table.

    Args:
        table: file to write the table to: .csv, .tex, .parquet, .md or .html; an existing one is
            replaced.
        columns: names of the table's columns, such as a,b; null: all, in .tex the main ones.
    """

    table: str | None = None
    columns: str | None = None


@dataclass(frozen=True, kw_only=True)
class ResultFiles(TableFiles):
    """Keys of a command that writes its table and plots its result.

    Args:
        plot: file to draw the result in: .pdf, .svg or .png.
    """

    plot: str | None = None

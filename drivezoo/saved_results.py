"""Read earlier results, and write tables of any rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from drivezoo.one_line_errors import one_line_errors

if TYPE_CHECKING:
    from drivezoo.training import Training
    from zoo.benchmark.benchmarked import Benchmarked
    from zoo.runs.table import Cell


@one_line_errors
def read_run(folder: str | Path) -> Training:
    """Return what `train` returned for a run's folder.

    Raises:
        InputError: the folder has no figures of a finished run.
    """
    from drivezoo.training import Training

    return Training.read(folder)


@one_line_errors
def read_benchmark(path: str | Path) -> Benchmarked:
    """Return what `benchmark` returned for a folder or its `result.json`.

    Raises:
        InputError: the file cannot be read.
    """
    from zoo.benchmark.benchmarked import Benchmarked

    return Benchmarked.read(path)


@one_line_errors
def write_table(rows: Sequence[Mapping[str, Cell]], path: str | Path) -> Path:
    """Write rows of figures as a .csv, .tex or .parquet file; return its path.

    Args:
        rows: figures by the name of their column, such as the `table()` of a result.
        path: file to write; an existing one is replaced.

    Raises:
        InputError: the file's name has another ending, or it cannot be written.
    """
    from zoo.runs.table import Table
    from zoo.runs.table_files import write_table as write

    return write(Table.of_figures(rows), path)

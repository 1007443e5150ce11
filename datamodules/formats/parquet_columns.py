"""Read columns of a dataset's Parquet files, which may come from another person."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from zoo.base.bounded_files import open_binary
from zoo.base.errors import InputError
from zoo.base.limits import check_most, check_unpacked

MOST_PARQUET_BYTES = 8_000_000_000
MOST_NUMBERS = 20_000_000  # of all columns that are read
BATCH_ROWS = 16  # rows with images that are read at a time
REMEDY = "download the dataset again"


def load_pyarrow() -> Any:
    """Return pyarrow with its Parquet module.

    Raises:
        InputError: it is not installed.
    """
    try:
        import pyarrow.parquet
    except ImportError:
        raise InputError(
            "Parquet files, of tables, shards and LeRobot's datasets, need pyarrow; "
            "pip install 'drivezoo[parquet]'"
        ) from None
    return pyarrow


def open_parquet(path: Path, names: Sequence[str]) -> Any:
    """Return an opened Parquet file with these columns.

    Raises:
        InputError: it is missing, no regular file, damaged, has too many rows or columns, lacks a
            column or has one twice.
    """
    pyarrow = load_pyarrow()
    try:
        found = pyarrow.parquet.ParquetFile(open_binary(path, MOST_PARQUET_BYTES))
        columns = found.schema_arrow.names
    except UnicodeDecodeError:
        raise InputError(f"{path}: a column's name is not UTF-8; rename the column") from None
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or 'damaged'}; {REMEDY}") from None
    except pyarrow.ArrowException as error:
        raise _damaged(path, error) from None
    check_most("rows", found.metadata.num_rows, path, "divide the dataset")
    check_most("columns", len(columns), path)
    if len(set(columns)) < len(columns):
        twice = next(name for name in columns if columns.count(name) > 1)
        raise InputError(f"{path}: has the column {twice!r:.80} more than once; rename one of them")
    if missing := [name for name in names if name not in columns]:
        raise InputError(f"{path}: no column {missing[0]:.80}; {REMEDY}")
    return found


def _damaged(path: Path, error: Exception) -> InputError:
    reason = " ".join(str(error).split())[:200]
    return InputError(f"{path}: the Parquet file is damaged ({reason}); {REMEDY}")


def read_table(path: Path, names: list[str]) -> dict[str, np.ndarray]:
    """Return columns of numbers, float64 [N] or [N, D].

    Raises:
        InputError: a column is missing, has no numbers, or the file is damaged.
    """
    file, pyarrow = open_parquet(path, names), load_pyarrow()
    # A few bytes can claim millions of equal numbers.
    claimed = sum(_claimed_numbers(file, name) for name in names)
    if claimed > MOST_NUMBERS:
        raise InputError(
            f"{path}: {', '.join(names)} have {claimed:,} numbers, more than the {MOST_NUMBERS:,} "
            "that are read; divide the dataset"
        )
    try:
        table = file.read(columns=names)
    except (OSError, pyarrow.ArrowException) as error:
        raise _damaged(path, error) from None
    return {name: _numbers(table.column(name), path, name) for name in names}


def _claimed_numbers(file: Any, name: str) -> int:
    """Return how many numbers a column claims to have, a list's numbers included."""
    groups = [file.metadata.row_group(number) for number in range(file.metadata.num_row_groups)]
    chunks = [group.column(number) for group in groups for number in range(group.num_columns)]
    return sum(one.num_values for one in chunks if one.path_in_schema.split(".")[0] == name)


def _numbers(column: Any, path: Path, name: str) -> np.ndarray:
    pyarrow, kind = load_pyarrow(), column.type
    if column.null_count:
        row = column.is_null().index(True).as_py() + 1
        raise InputError(f"{path}, row {row}: {name} is empty; correct or delete the row")
    try:
        if pyarrow.types.is_floating(kind) or pyarrow.types.is_integer(kind):
            return column.to_numpy().astype(np.float64)
        lists = column.combine_chunks()
        flat = lists.flatten().to_numpy(zero_copy_only=False).astype(np.float64)
        return flat.reshape(len(lists), -1)
    except (AttributeError, ValueError, TypeError, pyarrow.ArrowException):
        raise InputError(f"{path}: {name} has no numbers of one length; {REMEDY}") from None


def encoded_images(path: Path, key: str) -> Iterator[bytes]:
    """Yield the encoded images of a column, row by row.

    Raises:
        InputError: the file is damaged.
    """
    file, pyarrow, unpacked = open_parquet(path, [key]), load_pyarrow(), 0
    try:
        for batch in file.iter_batches(batch_size=BATCH_ROWS, columns=[key]):
            # A path next to the bytes is never opened.
            for one in batch.column(0).to_pylist():
                data = one if isinstance(one, bytes) else (one or {}).get("bytes") or b""
                unpacked += len(data)
                check_unpacked(unpacked, path.stat().st_size, path)
                yield data
    except (OSError, KeyError, AttributeError, pyarrow.ArrowException) as error:
        raise _damaged(path, error) from None

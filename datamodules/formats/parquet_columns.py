"""Read columns of a dataset's Parquet files, which may come from another person."""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from zoo.base.bounded_files import open_data
from zoo.base.errors import InputError, library_errors
from zoo.base.limits import check_most, check_unpacked

MOST_PARQUET_BYTES = 8_000_000_000
MOST_NUMBERS = 20_000_000  # of all columns that are read
BATCH_ROWS = 16  # rows with images that are read at a time
REMEDY = "download the dataset again"
DAMAGED = "the Parquet file is damaged"
# What a column may hold, by the names of pyarrow's types. A bool is no number.
_CONTENTS = {
    "numbers": re.compile(r"u?int\d+|halffloat|float|double|decimal\d+\(.*\)"),
    "texts": re.compile(r"(large_)?string(_view)?"),
    "images": re.compile(r"(large_)?binary(_view)?|fixed_size_binary\[\d+\]"),
}


def load_pyarrow() -> Any:
    """Return pyarrow with its Parquet module.

    Raises:
        InputError: it is not installed.
    """
    try:
        import pyarrow.compute
        import pyarrow.parquet
    except ImportError:
        raise InputError(
            "Parquet files, of tables, shards and LeRobot's datasets, need pyarrow; "
            'pip install "drivezoo[parquet]"'
        ) from None
    return pyarrow


def open_parquet(path: Path, names: Sequence[str]) -> Any:
    """Return an opened Parquet file with these columns.

    Raises:
        InputError: it is missing, no regular file, damaged, has too many rows or columns, lacks a
            column or has one twice.
    """
    pyarrow = load_pyarrow()
    with library_errors(path, DAMAGED, REMEDY):
        try:
            file = pyarrow.parquet.ParquetFile(open_data(path, MOST_PARQUET_BYTES))
            columns = file.schema_arrow.names
        except UnicodeDecodeError:
            raise InputError(f"{path}: a column's name is not UTF-8; rename the column") from None
    check_most("rows", file.metadata.num_rows, path, "divide the dataset")
    check_most("columns", len(columns), path)
    if len(set(columns)) < len(columns):
        twice = next(name for name in columns if columns.count(name) > 1)
        raise InputError(f"{path}: has the column {twice!r:.80} more than once; rename one of them")
    if missing := [name for name in names if name not in columns]:
        raise InputError(f"{path}: no column {missing[0]:.80}; {REMEDY}")
    return file


def contents(kind: Any) -> str:
    """Return what a column of a type holds: numbers, texts or images; `other` for all else."""
    types = load_pyarrow().types
    if types.is_dictionary(kind):
        return contents(kind.value_type)
    if types.is_struct(kind):  # an image's bytes, and a path, which is never opened
        position = kind.get_field_index("bytes")
        holds = position >= 0 and contents(kind.field(position).type) == "images"
        return "images" if holds else "other"
    return next((name for name, word in _CONTENTS.items() if word.fullmatch(str(kind))), "other")


def check_contents(path: Path, name: str, kind: Any, *expected: str) -> str:
    """Return what a column of a type holds; raise InputError if that is not expected."""
    if (content := contents(kind)) in expected:
        return content
    raise InputError(
        f"{path}: {name} is {kind!s:.80}, expected {' or '.join(expected)}; write it so, or "
        "name another column"
    )


def read_table(path: Path, names: list[str]) -> dict[str, np.ndarray]:
    """Return columns of numbers, float64 [N] or [N, D].

    Raises:
        InputError: a column is missing, has no numbers, or the file is damaged.
    """
    file = open_parquet(path, names)
    # A few bytes can claim millions of equal numbers.
    claimed = sum(_claimed_numbers(file, name) for name in names)
    if claimed > MOST_NUMBERS:
        raise InputError(
            f"{path}: {', '.join(names)} have {claimed:,} numbers, more than the {MOST_NUMBERS:,} "
            "that are read; divide the dataset"
        )
    with library_errors(path, DAMAGED, REMEDY):
        table = file.read(columns=names)
        return {name: _numbers(table.column(name), path, name) for name in names}


def _claimed_numbers(file: Any, name: str) -> int:
    """Return how many numbers a column claims to have, a list's numbers included."""
    groups = [file.metadata.row_group(number) for number in range(file.metadata.num_row_groups)]
    chunks = [group.column(number) for group in groups for number in range(group.num_columns)]
    return sum(chunk.num_values for chunk in chunks if chunk.path_in_schema.split(".")[0] == name)


def _numbers(column: Any, path: Path, name: str) -> np.ndarray:
    pyarrow, kind = load_pyarrow(), column.type
    types = pyarrow.types
    is_list = types.is_list(kind) or types.is_large_list(kind) or types.is_fixed_size_list(kind)
    check_contents(path, name, kind.value_type if is_list else kind, "numbers")
    if column.null_count:
        row = column.is_null().index(True).as_py() + 1
        raise InputError(f"{path}, row {row}: {name} is empty; correct or delete the row")
    rows, flat = len(column), column
    if is_list:
        lengths = pyarrow.compute.list_value_length(column).unique()
        flat = pyarrow.compute.list_flatten(column)
        if len(lengths) > 1 or flat.null_count:
            raise InputError(f"{path}: {name} has no numbers of one length; {REMEDY}")
    numbers = flat.to_numpy(zero_copy_only=False).astype(np.float64)
    return numbers.reshape(rows, len(numbers) // max(rows, 1)) if is_list else numbers


def component(column: np.ndarray, path: Path, name: str, position: int = 0) -> np.ndarray:
    """Return one number of each row of a column, float64 [N].

    Raises:
        InputError: the rows have fewer numbers.
    """
    numbers = column.reshape(len(column), -1) if len(column) else column.reshape(0, position + 1)
    if position < numbers.shape[1]:
        return numbers[:, position]
    raise InputError(
        f"{path}: {name} has {numbers.shape[1]} numbers a row, and number {position + 1} is "
        f"needed; {REMEDY}"
    )


def encoded_images(path: Path, key: str) -> Iterator[bytes]:
    """Yield the encoded images of a column, row by row.

    Raises:
        InputError: the column holds no images, or the file is damaged.
    """
    file, unpacked = open_parquet(path, [key]), 0
    check_contents(path, key, file.schema_arrow.field(key).type, "images")
    with library_errors(path, DAMAGED, REMEDY):
        for batch in file.iter_batches(batch_size=BATCH_ROWS, columns=[key]):
            for cell in batch.column(0).to_pylist():
                data = cell if isinstance(cell, bytes) else (cell or {}).get("bytes") or b""
                unpacked += len(data)
                check_unpacked(unpacked, path.stat().st_size, path)
                yield data

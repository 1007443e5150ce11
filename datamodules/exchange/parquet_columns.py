"""Read columns of a dataset's Parquet files, which may come from another person."""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from datamodules.errors import InputError
from datamodules.regular_file import open_regular

MOST_ROWS = 10_000_000
MOST_PARQUET_BYTES = 8_000_000_000
BATCH_ROWS = 1000  # rows with images that are read at a time
REMEDY = "download the dataset again"


def open_parquet(path: Path, pyarrow: Any) -> Any:
    """Return an opened Parquet file.

    Raises:
        InputError: it is missing, no regular file, damaged, or has too many rows.
    """
    try:
        descriptor, _ = open_regular(path, MOST_PARQUET_BYTES)
        file = os.fdopen(descriptor, "rb")
        found = pyarrow.parquet.ParquetFile(file)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or 'damaged'}; {REMEDY}") from None
    except pyarrow.ArrowException as error:
        raise _damaged(path, error) from None
    if found.metadata.num_rows > MOST_ROWS:
        raise InputError(
            f"{path}: {found.metadata.num_rows:,} rows, more than {MOST_ROWS:,}; divide the dataset"
        )
    return found


def _damaged(path: Path, error: Exception) -> InputError:
    reason = " ".join(str(error).split())[:200]
    return InputError(f"{path}: the Parquet file is damaged ({reason}); {REMEDY}")


def read_table(path: Path, names: list[str], pyarrow: Any) -> dict[str, np.ndarray]:
    """Return columns of numbers, float64 [N] or [N, D].

    Raises:
        InputError: a column is missing, has no numbers, or the file is damaged.
    """
    file = open_parquet(path, pyarrow)
    for name in names:
        if name not in file.schema_arrow.names:
            raise InputError(f"{path}: no column {name}; {REMEDY}")
    try:
        table = file.read(columns=names)
    except (OSError, pyarrow.ArrowException) as error:
        raise _damaged(path, error) from None
    return {name: _numbers(table.column(name), path, name, pyarrow) for name in names}


def _numbers(column: Any, path: Path, name: str, pyarrow: Any) -> np.ndarray:
    kind = column.type
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


def encoded_images(files: Sequence[Path], key: str, pyarrow: Any) -> Iterator[bytes]:
    """Yield the encoded images of a column, row by row.

    Raises:
        InputError: a file is damaged.
    """
    for path in files:
        file = open_parquet(path, pyarrow)
        try:
            for batch in file.iter_batches(batch_size=BATCH_ROWS, columns=[key]):
                # A path next to the bytes is never opened.
                yield from ((one or {}).get("bytes") or b"" for one in batch.column(0).to_pylist())
        except (OSError, KeyError, AttributeError, pyarrow.ArrowException) as error:
            raise _damaged(path, error) from None

"""Any CSV or Parquet table of images and steering, whose columns the user names.

It is read where `data.format=table` asks for it, with `data.columns={image: NAME, steering: NAME}`.
"""

from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from datamodules.driving_log import BadRows
from datamodules.formats.labels import collect, decimal, inside, labelled_recording, read_csv
from datamodules.formats.parquet_columns import encoded_images, load_pyarrow, open_parquet
from datamodules.image import StoredImage
from datamodules.read_options import MPS_PER, ReadOptions
from datamodules.recording import ForwardReader, Recording
from datamodules.steering_unit import SteeringUnit
from zoo.base.errors import InputError, UsageError
from zoo.base.limits import check_unpacked

title = "table"
UNIT = SteeringUnit()
SUFFIXES = (".csv", ".parquet")
# Names that `columns` may give, and those of the rows that they become.
IMAGES = {"image": "center", "center": "center", "left": "left", "right": "right"}
NUMBERS = {
    "steering": "steering",
    "throttle": "throttle",
    "brake": "brake",
    "speed": "speed_mps",
    "time": "time_s",
}
ROWS_AT_ONCE = 256  # each cell may repeat a long text that stands in the file once
# A time of at least so much is counted in so many parts of a second since 1970.
PARTS = ((1e17, 1e9), (1e14, 1e6), (1e11, 1e3))


def detect(path: Path) -> bool:
    """Return whether a path is a Parquet table; other tables need `data.format=table`."""
    return path.suffix == ".parquet" and path.is_file()


def read(path: Path, options: ReadOptions) -> Recording:
    """Return the rows of a table.

    Raises:
        InputError: the folder has not one table, a row or an image is bad, or the steering is not
            what the user says.
        UsageError: the columns are not named.
    """
    table, columns = _find_table(path), options.named_columns
    known = {**IMAGES, **NUMBERS}
    if not {"steering"} <= set(columns) <= set(known) or not {"image", "center"} & set(columns):
        raise UsageError(
            f"{table}: name its columns, 'data.columns={{image: NAME, steering: NAME}}'; others "
            f"are {', '.join(sorted(set(known) - {'image', 'center', 'steering'}))}"
        )
    folder = Path(options.images) if options.images else table.parent

    def parse(fields: Mapping[str, Any]) -> dict[str, Any]:
        row: dict[str, Any] = {}
        for key, name in columns.items():
            value = fields[name]
            if key in NUMBERS:
                row[NUMBERS[key]] = decimal(fields, name)
            elif isinstance(value, str):
                row[IMAGES[key]] = inside(folder, value) if value else None
            else:
                row[IMAGES[key]] = value
        return row

    bad = BadRows(options.on_bad_row)
    if table.suffix == ".csv":
        found: Iterator[tuple[str, Mapping[str, Any]]] = read_csv(
            table, list(columns.values()), bad
        )
    else:
        found = _parquet_rows(table, columns)
    rows = collect(found, parse, bad)
    if "speed_mps" in rows:
        rows["speed_mps"] = [MPS_PER[options.speed_unit] * speed for speed in rows["speed_mps"]]
    if "time_s" in rows:
        largest = max(rows["time_s"], default=0.0)
        parts = next((parts for least, parts in PARTS if largest >= least), 1.0)
        rows["time_s"] = [time / parts for time in rows["time_s"]]
    return labelled_recording(folder, rows, UNIT, options, bad, is_stated=False)


def _find_table(path: Path) -> Path:
    """Return a table, or the only one in a folder."""
    if path.is_file():
        return path
    tables = [file for file in sorted(path.glob("*")) if file.suffix in SUFFIXES]
    if len(tables) == 1:
        return tables[0]
    names = ", ".join(file.name for file in tables[:3])
    raise InputError(f"{path}: holds {names or 'no .csv and no .parquet'}; name one file")


def _holds_images(kind: Any) -> bool:
    """Return whether a Parquet column of this type holds images, not their paths."""
    pyarrow = load_pyarrow()
    return pyarrow.types.is_struct(kind) or pyarrow.types.is_binary(kind)


def _parquet_rows(
    table: Path, columns: Mapping[str, str]
) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield each row's place and fields; an image that stands in the table is a `StoredImage`."""
    file = open_parquet(table, list(columns.values()))
    stored = {
        name: ForwardReader(partial(encoded_images, key=name))
        for key, name in columns.items()
        if key in IMAGES and _holds_images(file.schema_arrow.field(name).type)
    }
    plain = [name for name in columns.values() if name not in stored]
    number = unpacked = 0
    for batch in file.iter_batches(batch_size=ROWS_AT_ONCE, columns=plain):
        unpacked += batch.nbytes
        check_unpacked(unpacked, table.stat().st_size, table)
        for fields in batch.to_pylist():
            images = {name: StoredImage(str(table), number, one) for name, one in stored.items()}
            number += 1
            yield f"{table}, row {number}", fields | images

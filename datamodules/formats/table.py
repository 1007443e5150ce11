"""Any CSV or Parquet table of images and steering, whose columns the user names.

It is read where `data.format=table` asks for it, with `data.columns={image: NAME, steering: NAME}`.
"""

import itertools
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from datamodules.driving_log import CAMERAS, IMAGE, BadRows, read_fields
from datamodules.format_options import MPS_PER, ReadOptions
from datamodules.formats.labels import collect, decimal, inside, labelled_recording, read_csv
from datamodules.formats.parquet_columns import (
    DAMAGED,
    REMEDY,
    check_contents,
    contents,
    encoded_images,
    open_parquet,
)
from datamodules.image import ForwardReader, StoredImage
from datamodules.recording import Recording
from datamodules.steering_unit import SteeringUnit
from datamodules.stretches import in_seconds
from zoo.base.errors import InputError, UsageError, library_errors
from zoo.base.limits import check_unpacked

title = "table"
uses = ("images", "columns", "speed_unit")  # of `ReadOptions`
UNKNOWN = "NAME"  # of a column that cannot be guessed
SUFFIXES = (".csv", ".tsv", ".parquet")
# Names that `columns` may give, and those of the rows that they become.
IMAGES = {"image": "center", "center": "center", "left": "left", "right": "right"}
NUMBERS = {
    "steering": "steering",
    "throttle": "throttle",
    "brake": "brake",
    "speed": "speed_mps",
    "time": "time_s",
}
STEERING_WORD = re.compile(r"steer|(^|[/_. ])angle($|[/_. ])", re.IGNORECASE)
_IMAGE_WORD = re.compile(r"image|img|frame|file|path|cent(er|re)", re.IGNORECASE)
ROWS_AT_ONCE = 256  # each cell may repeat a long text that stands in the file once


def detect(path: Path) -> bool:
    """Return whether a path is a Parquet table; other tables need `data.format=table`."""
    return path.suffix.lower() == ".parquet" and path.is_file()


def read(path: Path, options: ReadOptions) -> Recording:
    """Return the rows of a table.

    Raises:
        InputError: the folder has not one table, a row or an image is bad, or the steering is not
            what the user says.
        UsageError: the columns are not named.
    """
    table, columns = _find_table(path), options.named_columns
    meanings = {**IMAGES, **NUMBERS}
    if not {"steering"} <= set(columns) <= set(meanings) or not {"image", "center"} & set(columns):
        raise UsageError(
            f"{table}: has the columns {', '.join(find_columns(table)[0]):.200}; name its columns, "
            '"data.columns={image: NAME, steering: NAME}"; others are '
            f"{', '.join(sorted(set(meanings) - {'image', 'center', 'steering'}))}"
        )
    folder = Path(options.images).expanduser() if options.images else table.parent

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
    if table.suffix.lower() == ".parquet":
        records = _parquet_rows(table, columns)
    else:
        records = read_csv(table, list(columns.values()), bad)
    rows = collect(records, parse, bad)
    if "speed_mps" in rows:
        rows["speed_mps"] = [MPS_PER[options.speed_unit] * speed for speed in rows["speed_mps"]]
    if "time_s" in rows:
        rows["time_s"] = in_seconds(rows["time_s"])
    recording = labelled_recording(folder, rows, SteeringUnit(), options, bad, is_stated=False)
    return replace(recording, names=(str(path),))  # not the folder's: it may hold other tables


def _find_table(path: Path) -> Path:
    """Return a table, or the only one in a folder."""
    if path.is_file():
        return path
    tables = [file for file in sorted(path.glob("[!.]*")) if file.suffix.lower() in SUFFIXES]
    if len(tables) == 1:
        return tables[0]
    names = ", ".join(file.name for file in tables[:3])
    raise InputError(f"{path}: holds {names or 'no .csv and no .parquet'}; name one file")


def find_columns(table: Path) -> tuple[list[str], list[str]]:
    """Return a table's columns in words, and the keys that read it, with NAME for what is unknown.

    Raises:
        InputError: the file cannot be read.
    """
    if table.suffix.lower() == ".parquet":
        schema = open_parquet(table, ()).schema_arrow
        shown = names = schema.names
        images = [name for name in names if contents(schema.field(name).type) == "images"]
        numbers = []
    else:
        rows = [fields for _, fields in itertools.islice(read_fields(table, BadRows()), 2)] or [[]]
        shown = names = rows[0]
        if any(map(IMAGE.search, names)):  # no header
            shown = [f"{at} ({field})" for at, field in enumerate(names)]
            names = [str(at) for at in range(len(names))]
        pairs = list(zip(names, rows[-1], strict=False))
        images = [name for name, field in pairs if IMAGE.search(field)]
        numbers = [name for name, _ in pairs if shown != names and name not in images]
    if len(images) == len(CAMERAS) and (len(numbers) >= 4 or "center" in names):
        return shown, ["format=udacity"]
    images += [name for name in names if _IMAGE_WORD.search(name)]
    steering = [name for name in names if STEERING_WORD.search(name)] or numbers
    image, turn = images[0] if images else UNKNOWN, steering[0] if len(steering) == 1 else UNKNOWN
    return shown, ["format=table", f"columns={{image: {image}, steering: {turn}}}"]


def _parquet_rows(
    table: Path, columns: Mapping[str, str]
) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield each row's place and fields; an image that stands in the table is a `StoredImage`."""
    file = open_parquet(table, list(columns.values()))
    stored = {}
    for key, name in columns.items():
        expected = ("texts", "images" if key in IMAGES else "numbers")
        if check_contents(table, name, file.schema_arrow.field(name).type, *expected) == "images":
            stored[name] = ForwardReader(partial(encoded_images, key=name))
    plain = [name for name in columns.values() if name not in stored]
    number = unpacked = 0
    with library_errors(table, DAMAGED, REMEDY):
        for batch in file.iter_batches(batch_size=ROWS_AT_ONCE, columns=plain):
            unpacked += batch.nbytes
            check_unpacked(unpacked, table.stat().st_size, table)
            for fields in batch.to_pylist():
                images = {key: StoredImage(str(table), number, stored[key], key) for key in stored}
                number += 1
                yield f"{table}, row {number}", fields | images

"""Strategies that damage a valid file, and the check that a reader reports it in one line.

A test of a reader takes a small valid file, a strategy that damages it, and the reader:

    @FEW_AND_MANY
    def test_damaged_files_are_named(tmp_path, count):
        read_damaged(mutated_bytes(valid_bytes()), read_something, tmp_path / "file", count)
"""

import copy
import io
import json
import math
import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from zoo.base.errors import InputError

Reader = Callable[[Path], object]
# A hundred mutations in `make test`, thousands in `make test-all`.
FEW_AND_MANY = pytest.mark.parametrize("count", [100, pytest.param(3000, marks=pytest.mark.slow)])
ODD_BYTES = (b"\0", b"\xff", b"\xff" * 4, b"\xff" * 8, b"\x7f" + b"\xff" * 7, b"\n", b",", b'"')
ODD_VALUES: tuple[Any, ...] = (
    None, True, False, 0, 1, -1, 2**31, 2**63, 10**400, 0.0, 0.5, -1.0, 1e-320, 1e300, math.nan,
    math.inf, "", "x", "0", "\0", "\ud800", "../x", "/dev/zero", "9" * 5000, "x" * 10_000, [], {},
    [None], [[]], {"": 0}, [0] * 1000, {"x": {"x": {"x": 0}}},
)  # fmt: skip
ODD_FIELDS = (
    "", "x", "0", "-", "nan", "inf", "-Infinity", "1e999", "1e308", "-1e-320", "true", "None",
    "0,5", '"', "'", "\0", "\u00e9", "\udc80", "../../x.jpg", "/etc/passwd", "C:\\x\\y.jpg", "a:b",
    "9" * 5000, "center", "steering", "1.jpg", "=1+1", "\ufeff",
)  # fmt: skip


def read_damaged(damaged: st.SearchStrategy[bytes], read: Reader, path: Path, count: int) -> None:
    """Read many damaged files; each is read, or refused in one line that names it.

    Args:
        damaged: strategy of the file's bytes.
        read: reader of a path.
        path: path to write to, in the folder that the reader needs.
        count: number of damaged files.
    """

    def read_file(data: bytes) -> None:
        path.write_bytes(data)
        check_reading(read, path)

    for_each(damaged, read_file, count)


def for_each(examples: st.SearchStrategy[Any], test: Callable[[Any], None], count: int) -> None:
    """Call a test with so many examples of a strategy."""
    plan = settings(
        max_examples=count,
        phases=[Phase.generate, Phase.shrink],
        suppress_health_check=list(HealthCheck),
        report_multiple_bugs=False,
    )
    plan(given(examples)(test))()


def check_reading(read: Reader, path: Path) -> None:
    """Check that a reader reads a file, or refuses it in one line that names it."""
    try:
        read(path)
    except InputError as error:
        line = str(error)
        assert f"{path.stem}." in line  # or a file of the same name with the weights
        assert "\n" not in line
        assert len(line) < 800 + 2 * len(str(path))


@st.composite
def mutated_bytes(draw: st.DrawFn, data: bytes) -> bytes:
    """Draw a file with one to four changes: bytes that are flipped, lost, doubled or added."""
    contents = bytearray(data)
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, max(0, len(contents) - 1)))
        to = at + draw(st.sampled_from((1, 2, 8, 64, 1024)))
        how = draw(st.sampled_from(("flip", "set", "insert", "delete", "repeat", "move", "cut")))
        if how == "flip" and contents:
            contents[at] ^= 1 << draw(st.integers(0, 7))
        elif how == "set":
            odd = draw(st.sampled_from(ODD_BYTES))
            contents[at : at + len(odd)] = odd
        elif how == "insert":
            contents[at:at] = draw(st.sampled_from(ODD_BYTES) | st.binary(max_size=16))
        elif how == "delete":
            del contents[at:to]
        elif how == "repeat":
            contents[at:at] = contents[at:to] * draw(st.sampled_from((1, 2, 100)))
        elif how == "move":
            part = contents[at:to]
            del contents[at:to]
            index = draw(st.integers(0, len(contents)))
            contents[index:index] = part
        elif how == "cut":
            del contents[at:]
    return bytes(contents)


@st.composite
def mutated_value(draw: st.DrawFn, value: Any, odd: tuple = ODD_VALUES) -> Any:
    """Draw plain containers with one to three changes of their values, keys or structure.

    Args:
        draw: hypothesis' function.
        value: dicts, lists and values.
        odd: values to put in place of others.
    """
    root = [copy.deepcopy(value)]
    for _ in range(draw(st.integers(1, 3))):
        inner, key = draw(st.sampled_from(_places(root)))
        how = draw(st.sampled_from(("odd", "odd", "odd", "delete", "copy", "wrap", "rename")))
        if how == "odd" or inner is root:
            inner[key] = copy.deepcopy(draw(st.sampled_from(odd)))
        elif how == "delete":
            del inner[key]
        elif how == "copy":
            other, other_key = draw(st.sampled_from(_places(root)))
            inner[key] = copy.deepcopy(other[other_key])
        elif how == "wrap":
            inner[key] = draw(st.sampled_from(([inner[key]] * 2, {"x": inner[key]})))
        elif isinstance(inner, dict):
            inner[draw(st.sampled_from(("", "x", "\0", *map(str, inner))))] = inner.pop(key)
        else:
            inner.insert(key, copy.deepcopy(inner[key]))
    return root[0]


@st.composite
def mutated_csv(draw: st.DrawFn, data: bytes) -> bytes:
    """Draw a table of text with one to three changes of its fields, rows or separators."""
    rows = [line.split(",") for line in data.decode().splitlines()]
    for _ in range(draw(st.integers(1, 3))):
        row = rows[draw(st.integers(0, len(rows) - 1))]
        column = draw(st.integers(0, len(row) - 1))
        how = draw(st.sampled_from(("odd", "odd", "delete", "add", "copy", "row", "column", "cut")))
        if how == "odd":
            row[column] = draw(st.sampled_from(ODD_FIELDS))
        elif how == "delete" and len(row) > 1:
            del row[column]
        elif how == "add":
            row.insert(column, draw(st.sampled_from(ODD_FIELDS)))
        elif how == "copy":
            row[column] = draw(st.sampled_from(draw(st.sampled_from(rows)) or [""]))
        elif how == "row":
            rows.insert(draw(st.integers(0, len(rows))), list(draw(st.sampled_from(rows))))
        elif how == "column":
            odd, index = draw(st.sampled_from(ODD_FIELDS)), draw(st.booleans())
            for number, changed in enumerate(rows):
                changed.insert(column, str(number) if index else odd)
        else:
            del rows[draw(st.integers(1, len(rows))) :]
    separator = draw(st.sampled_from((",", ",", ",", ";", "\t", "|", ", ", ",,")))
    end = draw(st.sampled_from(("\n", "\n", "\r\n", ",\n", "\n\n", "\r")))
    return end.join([separator.join(row) for row in rows] + [""]).encode("utf-8", "surrogatepass")


@st.composite
def mutated_parquet(draw: st.DrawFn, data: bytes) -> bytes:
    """Draw a Parquet file in which a column has another type, shape or name, or is lost."""
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    table = pq.read_table(io.BytesIO(data))
    at = draw(st.integers(0, table.num_columns - 1))
    name, values = table.column_names[at], table.column(at).to_pylist()
    numbers = list(range(len(values)))
    odd = draw(st.sampled_from((math.nan, math.inf, -1e300, 2.0**62, -1.0, None)))
    row = draw(st.integers(0, len(values) - 1))
    text, ragged = [f"../{n}.jpg" for n in numbers], [[0.5] * (n % 4) for n in numbers]
    columns: dict[str, Callable[[], Any]] = {
        "odd": lambda: pa.array([*map(float, numbers[:row]), odd, *map(float, numbers[row + 1 :])]),
        "null": lambda: pa.nulls(len(values)),
        "bool": lambda: pa.array([True] * len(values)),
        "time": lambda: pa.array(numbers, pa.timestamp("us")),
        "decimal": lambda: pa.array(numbers).cast(pa.decimal128(38, 2)),
        "half": lambda: pa.array(np.zeros(len(values), np.float16)),
        "uint64": lambda: pa.array([2**64 - 1] * len(values), pa.uint64()),
        "ragged": lambda: pa.array(ragged, pa.list_(pa.float64())),
        "large list": lambda: pa.array([[0.5]] * len(values), pa.large_list(pa.float64())),
        "empty lists": lambda: pa.array([[]] * len(values), pa.list_(pa.float64())),
        "pairs": lambda: pa.array([[0.5, 1.0]] * len(values), pa.list_(pa.float64(), 2)),
        "lists of lists": lambda: pa.array([[[0.5]]] * len(values)),
        "list of nulls": lambda: pa.array([[None]] * len(values), pa.list_(pa.float64())),
        "text": lambda: pa.array(text),
        "large text": lambda: pa.array(text, pa.large_string()),
        "text view": lambda: pa.array(text, pa.string_view()),
        "texts once": lambda: pa.array(text).dictionary_encode(),
        "bytes": lambda: pa.array([path.encode() for path in text]),
        "large bytes": lambda: pa.array([path.encode() for path in text], pa.large_binary()),
        "bytes view": lambda: pa.array([path.encode() for path in text], pa.binary_view()),
        "fixed bytes": lambda: pa.array([b"/etc/passwd"] * len(values), pa.binary(11)),
        "struct": lambda: pa.array([{"path": path} for path in text]),
        "texts in a struct": lambda: pa.array([{"bytes": path, "path": path} for path in text]),
        "nulls in a struct": lambda: pa.array([{"bytes": None, "path": path} for path in text]),
    }
    how = draw(st.sampled_from(("lose", "rename", "twice", "no rows", "fewer", *columns)))
    if how == "lose":
        table = table.remove_column(at)
    elif how == "rename":
        table = table.rename_columns([col + "x" * (col == name) for col in table.column_names])
    elif how == "twice":
        table = table.append_column(name, table.column(at))
    elif how in ("no rows", "fewer"):
        table = table.slice(0, 0 if how == "no rows" else row)
    else:
        table = table.set_column(at, name, columns[how]())
    written = io.BytesIO()
    pq.write_table(table, written)
    return written.getvalue()


def mutated_json(value: Any) -> st.SearchStrategy[bytes]:
    """Return a strategy of JSON files whose values or bytes are damaged."""
    changed = mutated_value(value).map(lambda result: json.dumps(result).encode())
    return changed | mutated_bytes(json.dumps(value).encode())


@st.composite
def mutated_zip(
    draw: st.DrawFn, data: bytes, members: dict[str, st.SearchStrategy[bytes]] | None = None
) -> bytes:
    """Draw a zip archive with damaged, lost, doubled, renamed or deflated members.

    Args:
        draw: hypothesis' function.
        data: valid archive.
        members: strategies of the contents of some members, by the end of their names.
    """
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        entries = [(info.filename, archive.read(info)) for info in archive.infolist()]
    ways = ("change", "change", "change", "lose", "double", "rename", "deflate")
    how = draw(st.sampled_from(ways))
    at = draw(st.integers(0, len(entries) - 1))
    if how == "change":
        strategies = dict(enumerate([mutated_bytes(contents) for _, contents in entries]))
        for end, strategy in (members or {}).items():
            numbers = [number for number, (name, _) in enumerate(entries) if name.endswith(end)]
            strategies |= dict.fromkeys(numbers, strategy)
            at = draw(st.sampled_from([at, *numbers]))
        entries[at] = entries[at][0], draw(strategies[at])
    elif how == "lose":
        del entries[at]
    elif how == "double":
        entries.append((entries[at][0], draw(st.sampled_from(entries))[1]))
    elif how == "rename":
        name = draw(st.sampled_from(("x", "../x", "/x", *(name for name, _ in entries))))
        entries[at] = name, entries[at][1]
    written = io.BytesIO()
    kind = zipfile.ZIP_DEFLATED if how == "deflate" else zipfile.ZIP_STORED
    with warnings.catch_warnings(), zipfile.ZipFile(written, "w", kind) as archive:
        warnings.simplefilter("ignore")  # of a name that is there twice
        for name, contents in entries:
            archive.writestr(name, contents)
    return written.getvalue()


def _places(value: Any) -> list[tuple[Any, Any]]:
    """Return each container within a value, with each of its keys or positions."""
    if not isinstance(value, dict | list):
        return []
    keys = list(value) if isinstance(value, dict) else range(len(value))
    inner = [pair for key in keys for pair in _places(value[key])]
    return [*((value, key) for key in keys), *inner]

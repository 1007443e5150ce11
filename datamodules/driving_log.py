"""Parse `driving_log.csv`, as the original simulator, the course and forks of both write it."""

import codecs
import csv
import itertools
import math
import os
import re
from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple, TextIO

from datamodules.steering_unit import EXAMPLE, SteeringUnit
from zoo.base.bounded_files import open_text
from zoo.base.errors import InputError
from zoo.base.limits import check_most

COLUMNS = ("center", "left", "right", "steering", "throttle", "brake", "speed")
CAMERAS = COLUMNS[:3]
NUMBERS = COLUMNS[3:]
# Ranges of the numbers. Forks reverse with a throttle below 0; the original's car reaches 31 mph.
RANGES = {"steering": (-1, 1), "throttle": (-1, 1), "brake": (0, 1), "speed": (0, 200)}
ROUNDING = 1e-6  # by which 32 bits may write a number beyond its range

MOST_LOG_BYTES = 500_000_000  # of a million rows, as many as are read
HINTED_SHARE = 0.05  # share of bad rows from which a cause that all rows share is likely
MANY_ROWS = "divide the recording"

# A number with a decimal comma as C# writes it: no needless zero at the start or end, and one digit
# before the comma if there is an exponent.
_NUMBER = re.compile(r"-?((0|[1-9]\d*)(,\d*[1-9])?|[1-9](,\d*[1-9])?E[-+]?\d+)$", re.IGNORECASE)
_HEADING = re.compile(r"[A-Za-z_][\w /-]*")  # a column's name
# Bytes that are not UTF-8, as `surrogateescape` decodes them, and NUL, in a path's last part.
_NO_TEXT = re.compile(r"[\0\udc80-\udcff][^/\\]*$")
_UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
IMAGE = re.compile(r"\.(jpe?g|png)$", re.IGNORECASE)
_BETWEEN_FIELDS = re.compile(r"(?<!\d),|,(?!\d)")  # not a decimal comma
_SEPARATORS = {"\t": "tabs", ";": "semicolons", "|": "bars"}
HEAD_ROWS = 100  # from which the columns of a log without names are found


class BadRows:
    """The rows of one recording that cannot be used.

    Args:
        on_bad_row: `fail` refuses the recording, `skip` leaves the rows out.

    Attributes:
        faults: place and fault of each bad row, in the order of the rows.
        notes: a line on what was inferred of the file.
    """

    def __init__(self, on_bad_row: str = "fail") -> None:
        self._skips = on_bad_row == "skip"
        self.faults: list[str] = []
        self.notes: list[str] = []

    def finish(self, good: int, hint: str = "") -> None:
        """Refuse the recording if a row is bad, unless bad rows are left out and others remain.

        Args:
            good: number of the other rows.
            hint: likely cause of many bad rows, and its remedy.

        Raises:
            InputError: names the first bad row, the number of bad rows, and the remedy.
        """
        bad, rows = len(self.faults), good + len(self.faults)
        is_hinted = bool(hint and bad >= HINTED_SHARE * rows)
        if self._skips and bad and good and is_hinted:
            self.faults[0] += f"; {hint}"
        if not bad or (self._skips and good):
            return
        first = self.faults[0]
        if bad > 1:
            first += f" ({bad:,} of {rows:,} rows are bad)"
        if is_hinted:
            raise InputError(f"{first}; {hint}")
        skip = ", or leave out bad rows with on_bad_row=skip (in a training data.on_bad_row=skip)"
        what = "all rows" if bad == rows > 1 else "the row"
        raise InputError(f"{first}; correct or delete {what}{skip if good else ''}")


class LogRow(NamedTuple):
    """One row of a log.

    Attributes:
        line: line number, from 1.
        paths: path for each of `CAMERAS`, '' without that camera.
        numbers: steering -1..1, throttle, brake, speed in mph.
    """

    line: int
    paths: tuple[str, ...]
    numbers: tuple[float, ...]


def read_log(
    log: Path, bad: BadRows | None = None, unit: SteeringUnit | None = None
) -> Iterator[LogRow]:
    """Yield the rows of `driving_log.csv`, with or without header, in any locale's numbers.

    A decimal comma splits a number into two fields. They are joined so that each number is within
    its range. If several readings remain, those with throttle and brake at once are dropped (the
    simulator cannot write them); of the others, the speed nearest to the previous row's counts.

    Args:
        log: path of the log.
        bad: collector of rows that cannot be used, which refuses the log after its last row, or
            leaves them out; None refuses it.
        unit: what the steering's numbers mean; None for -1..1, right positive.

    Raises:
        InputError: a row has the wrong number of columns, a quote that is not closed in its
            row, an image name that is not UTF-8, or a value that is no number or out of range; the
            header names a column twice or lacks one; the log is UTF-16, has too many rows, or none.
    """
    bad = bad or BadRows()
    previous_speed, beyond, turns = 0.0, set[float](), False
    head = [fields for _, fields in itertools.islice(read_fields(log, BadRows()), HEAD_ROWS)]
    order, is_named = _column_order(log, head, bad.notes)
    line = good = 0
    fields: list[str] = []
    for line, fields in itertools.islice(read_fields(log, bad), is_named, None):
        check_most("rows", line, log, MANY_ROWS)
        try:
            paths, values = _arrange(fields, order)
            numbers = _parse_numbers(values, previous_speed, unit or SteeringUnit())
            if not (text := "".join(paths)).isascii() or "\0" in text:
                paths = tuple(map(printable_path, paths))
        except InputError as error:
            if _is_header(fields):  # of a log that was joined to another one
                order, _ = _column_order(log, [fields], [])
                bad.notes.append(f"{log.name}: row {line} is a header of the rows below it")
            else:
                bad.faults.append(f"{log}, row {line}: {error}")
            continue
        previous_speed = numbers[3]
        if unit:
            numbers = (unit.steering(numbers[0]), *numbers[1:])
        if fault := range_fault(numbers):
            bad.faults.append(f"{log}, row {line}: {fault}")
            beyond.add(numbers[0])
            continue
        good += 1
        turns = turns or numbers[0] != 0
        yield LogRow(line, paths, numbers)
    # As 0.5,1,0 or 0.5,1,0, or 0.5,1,0,- of 0.5,1,0,-9
    is_cut = not "".join(fields[len(order) - 1 :]).strip("+-.")
    if good and is_cut and bad.faults and bad.faults[-1].startswith(f"{log}, row {line}:"):
        forget_half_written(log, bad)
    if not good and not bad.faults:
        raise InputError(f"{log}: the log has no rows; record some driving first")
    bad.finish(good, unit_hint(beyond, turns))


def forget_half_written(log: Path, bad: BadRows) -> None:
    """Leave out the last fault if the file ends within its row: a program is still writing it."""
    with log.open("rb") as file:
        file.seek(-1, os.SEEK_END)
        if file.read(1) not in b"\r\n":
            bad.faults.pop()


def read_fields(log: Path, bad: BadRows) -> Iterator[tuple[int, list[str]]]:
    """Yield each row's line and stripped fields, without empty rows; a fault for each other row."""
    with open_text(log, MOST_LOG_BYTES) as file:
        head = file.buffer.read(4)
    one_byte_apart = (head[::2] == b"\0\0") != (head[1::2] == b"\0\0")
    if head.startswith(_UTF_16) or one_byte_apart:  # as Notepad or Excel saves "Unicode"
        raise InputError(
            f"{log}, row 1: the log is UTF-16, not UTF-8; save it as UTF-8 in an editor, or with "
            "iconv -f UTF-16 -t UTF-8"
        )
    # A folder's name may be in an old code page: images are found by their file names.
    with open_text(log, MOST_LOG_BYTES, errors="surrogateescape") as file:
        delimiter = find_delimiter(file)
        if delimiter in _SEPARATORS:
            bad.notes.append(f"{log.name}: its columns are separated by {_SEPARATORS[delimiter]}")
        reader = csv.reader(file, delimiter=delimiter, skipinitialspace=True)
        while True:
            line = reader.line_num + 1
            try:
                fields = next(reader, None)
            except csv.Error as error:
                bad.faults.append(f"{log}, row {line}: not a CSV row ({error})")
                continue
            if fields is None:
                return
            if reader.line_num > line:
                closes = f"a quote opens here and closes in row {reader.line_num}"
                bad.faults.append(f"{log}, row {line}: {closes}")
                continue
            fields = [field.strip() for field in fields]
            if any(fields) and fields != ["sep=", ""]:  # by which Excel names the delimiter
                yield line, fields


def find_delimiter(file: TextIO) -> str:
    """Return the delimiter of the first line with text, whose numbers may have decimal commas."""
    line = next(filter(str.strip, file), "")
    file.seek(0)
    counts = {",": len(_BETWEEN_FIELDS.findall(line))}
    counts |= {separator: line.count(separator) for separator in _SEPARATORS}
    return max(counts, key=lambda separator: counts[separator])


def printable_path(path: str) -> str:
    """Return a path that can be printed; raise InputError if its file name is not UTF-8."""
    if match := _NO_TEXT.search(path):
        name = replace_undecoded(match.group())
        raise InputError(f"the image name {name:.200} is not UTF-8 (save the log as UTF-8)")
    return replace_undecoded(path)


def replace_undecoded(text: str) -> str:
    """Return a text with U+FFFD for each byte that `read_fields` could not decode."""
    return text.encode(errors="surrogateescape").decode(errors="replace").replace("\0", "\ufffd")


def range_fault(numbers: Sequence[float]) -> str:
    """Return what is wrong with the range of a row's numbers, '' if nothing is."""
    for name, value in zip(NUMBERS, numbers, strict=True):
        low, high = RANGES[name]
        if not low - ROUNDING <= value <= high + ROUNDING:
            return f"{name} is {number_text(value)}, beyond {low}..{high}"
    return ""


def unit_hint(steering: Collection[float], turns: bool) -> str:
    """Return the remedy of a steering in another unit, '' if the rows do not show one.

    Args:
        steering: distinct steering of the bad rows.
        turns: whether other rows steer to a side within -1..1. Then a single number beyond is no
            unit, but marks rows, as a receiver without signal does.
    """
    beyond = [value for value in steering if RANGES["steering"][1] < abs(value) < math.inf]
    if not beyond or (turns and len(beyond) == 1):
        return ""
    return f'degrees, or another unit? name it: "data.steering={{{EXAMPLE}}}"'


def _is_header(fields: list[str]) -> bool:
    return any(field.lower() in ("center", "centre") for field in fields)


def _column_order(log: Path, rows: list[list[str]], notes: list[str]) -> tuple[list[str], bool]:
    """Return the columns' names, and whether the first row is a header.

    Args:
        log: path of the log, for messages.
        rows: first rows of the log.
        notes: list to which a line on columns that nothing names is added.
    """
    first = rows[0] if rows else []
    is_header = _is_header(first)
    words = [field for field in first if field]
    if len(words) > 1 and all(map(_HEADING.fullmatch, words)) and not is_header:
        raise InputError(
            f"{log}, row 1: the header {','.join(first):.200} is of another format; name its "
            f"columns {','.join(COLUMNS)} (left and right may be missing), or read it with "
            "format=table and columns="
        )
    # As pandas numbers columns.
    is_named = is_header or (bool(words) and words == [*map(str, range(len(words)))])
    fields = without_empty(rows[is_named] if len(rows) > is_named else [])
    index = len([*itertools.takewhile(str.isdigit, fields)])
    if is_header:
        names = [replace_undecoded(field).lower() for field in without_empty(first)]
        names = ["center" if name == "centre" else name for name in names]
        other = ",".join(name for name in names if name not in COLUMNS)
        for name in COLUMNS:
            least = 0 if name in ("left", "right") else 1
            if not least <= names.count(name) <= 1:
                raise InputError(
                    f"{log}, row 1: the header names {name} {names.count(name)} times (unknown: "
                    f"{other or '-':.200}); name the columns {','.join(COLUMNS)}, or delete the "
                    "line if they stand in this order"
                )
    else:
        is_single = len([field for field in fields if IMAGE.search(field)]) == 1
        # After the only image stands the steering, not an empty path.
        names = [*(CAMERAS[:1] if is_single and any(fields[index + 1 : index + 2]) else CAMERAS)]
        names += NUMBERS
    surplus = len(fields) - len(names)
    # Decimal commas make a row longer, too.
    alike = [row for row in rows[is_named:] if len(row) == len(rows[is_named])]
    has_points = any("." in field for row in alike for field in row[-max(surplus, 0) - 4 :])
    if surplus > 0 and names[0] == "center" and (has_points or index == surplus):
        names = [""] * min(index, surplus) + names + [""] * (surplus - index)
        shown = ",".join(name or "-" for name in names)
        notes.append(f"{log.name}: its columns are taken for {shown:.200}")
    return names, is_named


def without_empty(fields: list[str], least: int = 0) -> list[str]:
    """Return fields without the empty ones at the end that are more than `least`."""
    while len(fields) > least and not fields[-1]:
        fields = fields[:-1]
    return fields


def _arrange(fields: list[str], order: list[str]) -> tuple[tuple[str, ...], list[str]]:
    """Return a row's three paths and its numbers' fields, over 4 if they have decimal commas."""
    fields = without_empty(fields, len(order))
    if order == [*COLUMNS] and len(fields) == len(order):  # nearly every log
        return (fields[0], fields[1], fields[2]), fields[3:]
    cameras = [name for name in order if name in CAMERAS]
    has_commas = order == [*cameras, *NUMBERS] and 0 < len(fields) - len(order) <= len(NUMBERS)
    if len(fields) == len(order) or has_commas:
        cells = dict(zip(order, fields, strict=False))
        numbers = fields[len(cameras) :] if has_commas else [cells[name] for name in NUMBERS]
        return tuple(cells[name] if name in cameras else "" for name in CAMERAS), numbers
    raise InputError(f"{len(fields)} columns, expected {len(order)} ({','.join(order):.200})")


def _parse_numbers(values: list[str], last_mph: float, unit: SteeringUnit) -> tuple[float, ...]:
    if len(values) == len(NUMBERS):
        with suppress(ValueError):  # three times as fast as a number at a time
            parsed = tuple(map(float, values))
            if math.isfinite(sum(parsed)):
                return parsed
        return tuple(map(_number, NUMBERS, values))
    readings = list(_decimal_comma_readings(values, unit))
    if not readings:
        raise InputError(f"{','.join(values)!r:.200} are not the four numbers {','.join(NUMBERS)}")
    return min(readings, key=lambda read: (read[1] * read[2] > 0, abs(read[3] - last_mph)))


def _number(name: str, text: str) -> float:
    try:
        value = float(text.replace(",", "."))
    except ValueError:
        value = math.nan
    if math.isfinite(value):
        return value
    raise InputError(f"{name} is {text!r:.80}, not a finite number")


def _decimal_comma_readings(pieces: list[str], unit: SteeringUnit) -> Iterator[tuple[float, ...]]:
    """Yield each way to join neighbouring pieces into four numbers that the simulator could write.

    >>> list(_decimal_comma_readings(["0", "25", "1", "0", "30", "19028"], SteeringUnit()))
    [(0.25, 1.0, 0.0, 30.19028)]
    """
    for joined in itertools.combinations(range(len(NUMBERS)), len(pieces) - len(NUMBERS)):
        rest = iter(pieces)
        texts = [
            f"{next(rest)},{next(rest)}" if position in joined else next(rest)
            for position in range(len(NUMBERS))
        ]
        if all(map(_NUMBER.match, texts)):
            numbers = tuple(float(text.replace(",", ".")) for text in texts)
            if not range_fault((unit.steering(numbers[0]), *numbers[1:])):
                yield numbers


def number_text(value: float) -> str:
    """Return a number as a log has it, which reads back to the bit.

    >>> number_text(0.1), number_text(30.0)
    ('0.1', '30')
    """
    return f"{float(value)!r}".removesuffix(".0")

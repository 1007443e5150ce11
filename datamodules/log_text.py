"""A log's text: its encoding, delimiter and quotes."""

import codecs
import csv
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TextIO

from zoo.base.errors import InputError
from zoo.base.regular_file import MOST_LINE, open_text

MOST_LOG_BYTES = 500_000_000  # of a million rows, as many as are read

# Bytes that are not UTF-8, as `surrogateescape` decodes them, and NUL, in a path's last part.
_NO_TEXT = re.compile(r"[\0\udc80-\udcff][^/\\]*$")
_UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


def read_fields(log: Path, faults: list[str]) -> Iterator[tuple[int, list[str]]]:
    """Yield each row's line and stripped fields, without empty rows; a fault for each other row."""
    _refuse_utf_16(log)
    # A folder's name may be in an old code page: images are found by their file names.
    with open_text(log, MOST_LOG_BYTES, errors="surrogateescape") as file:
        reader = csv.reader(file, delimiter=find_delimiter(file), skipinitialspace=True)
        while True:
            line = reader.line_num + 1
            try:
                fields = next(reader, None)
            except csv.Error as error:
                faults.append(f"{log}, row {line}: not a CSV row ({error})")
                continue
            if fields is None:
                return
            if reader.line_num > line:
                closes = f"a quote opens here and closes in row {reader.line_num}"
                faults.append(f"{log}, row {line}: {closes}")
                continue
            fields = [field.strip() for field in fields]
            if any(fields):
                yield line, fields


def find_delimiter(file: TextIO) -> str:
    """Return the delimiter of the first line, whose numbers may have decimal commas."""
    line = file.readline(MOST_LINE)
    file.seek(0)
    return ";" if line.count(";") >= max(3, line.count(",")) else ","


def _refuse_utf_16(log: Path) -> None:
    """Raise InputError for a log that Notepad or Excel saved as "Unicode"."""
    with open_text(log, MOST_LOG_BYTES) as file:
        head = file.buffer.read(4)
    one_byte_apart = (head[::2] == b"\0\0") != (head[1::2] == b"\0\0")
    if head.startswith(_UTF_16) or one_byte_apart:
        raise InputError(
            f"{log}, row 1: the log is UTF-16, not UTF-8; save it as UTF-8 in an editor, or with "
            "iconv -f UTF-16 -t UTF-8"
        )


def printable_path(path: str) -> str:
    """Return a path that can be printed; raise InputError if its file name is not UTF-8."""
    if found := _NO_TEXT.search(path):
        name = replace_undecoded(found.group())
        raise InputError(f"the image name {name:.200} is not UTF-8 (save the log as UTF-8)")
    return replace_undecoded(path)


def replace_undecoded(text: str) -> str:
    """Return a text with U+FFFD for each byte that `read_fields` could not decode."""
    return text.encode(errors="surrogateescape").decode(errors="replace").replace("\0", "\ufffd")

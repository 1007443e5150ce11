"""Read JSON that somebody else wrote: limits, one-line errors, checked types."""

import json
import math
from pathlib import Path
from typing import Any

from datamodules.errors import InputError
from datamodules.regular_file import read_regular

MOST_JSON_BYTES = 16_000_000


def read_bounded(path: Path, most_bytes: int = MOST_JSON_BYTES) -> str:
    """Return a text file's contents.

    Raises:
        InputError: it is missing, no regular file, too large or not UTF-8.
    """
    try:
        return read_regular(path, most_bytes).decode("utf-8-sig")
    except OSError as error:
        raise InputError(
            f"{path}: {error.strerror or error}; copy the whole folder again"
        ) from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: the file is not UTF-8; copy the whole folder again") from None


def parse(text: str, place: str, kind: type) -> Any:
    """Return parsed JSON of this kind, `dict` or `list`.

    Raises:
        InputError: the text is no JSON, or of another kind.
    """
    try:
        found = json.loads(text)
    except (ValueError, RecursionError) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"{place}: no JSON ({reason}); correct or delete the row") from None
    if not isinstance(found, kind):
        expected = "an object {...}" if kind is dict else "a list [...]"
        raise InputError(f"{place}: expected {expected}; copy the whole folder again")
    return found


def number(found: dict, key: str, place: str, default: float | None = None) -> float:
    """Return the finite number at a key; `default` if the key is missing.

    Raises:
        InputError: there is no finite number.
    """
    value = found.get(key, default)
    try:
        if isinstance(value, int | float) and not isinstance(value, bool):
            as_float = float(value)
            if math.isfinite(as_float):
                return as_float
    except OverflowError:
        pass
    raise InputError(f"{place}: {key} is {value!r:.40}, no number; correct or delete the row")


def whole(found: dict, key: str, place: str) -> int:
    """Return the whole number, 0 or more, at a key.

    Raises:
        InputError: there is none.
    """
    value = number(found, key, place)
    if value < 0 or value != int(value):
        raise InputError(f"{place}: {key} is {value:g}, no whole number of 0 or more; correct it")
    return int(value)


def plain_name(value: object, place: str, what: str) -> str:
    """Return a file name without a folder.

    Raises:
        InputError: it is no text, or leads to another folder.
    """
    if isinstance(value, str) and value not in ("", ".", "..") and not set(value) & set("/\\\0:"):
        return value
    raise InputError(
        f"{place}: {what} is {value!r:.80}, not the name of a file in the folder; correct or "
        "delete the row"
    )

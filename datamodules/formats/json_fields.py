"""Check fields of another format's JSON files, with one-line errors."""

from typing import Any

from zoo.base.errors import InputError
from zoo.base.limits import is_ordinary
from zoo.base.plain_files import check_text, parse_json

MOST = 1e308  # near the largest float


def parse(text: str, source: str, kind: type) -> Any:
    """Return parsed JSON of this kind, `dict` or `list`.

    Raises:
        InputError: the text is no JSON, or of another kind.
    """
    try:
        value = check_text(parse_json(text))
    except ValueError as error:
        reason = " ".join(str(error).split())
        raise InputError(f"{source}: no JSON ({reason}); correct or delete it") from None
    if not isinstance(value, kind):
        expected = "an object {...}" if kind is dict else "a list [...]"
        raise InputError(f"{source}: expected {expected}; correct or delete it")
    return value


def number(record: dict, key: str, source: str, default: float | None = None) -> float:
    """Return the finite number at a key; `default` if the key is missing.

    Raises:
        InputError: there is no finite number.
    """
    value: Any = record.get(key, default)
    if is_ordinary(value, most=MOST):  # neither NaN nor infinity
        return float(value)
    raise InputError(f"{source}: {key} is {value!r:.40}, no number; correct or delete the row")


def plain_name(value: object, source: str, what: str) -> str:
    """Return a file name without a folder.

    Raises:
        InputError: it is no text, or leads to another folder.
    """
    if isinstance(value, str) and value not in ("", ".", "..") and not set(value) & set("/\\\0:"):
        return value
    raise InputError(
        f"{source}: {what} is {value!r:.80}, not the name of a file in the folder; correct or "
        "delete the row"
    )

"""Checks of values from a user's YAML file; each error is one line with key, value and fix."""

import difflib

import numpy as np

from zoo.base.errors import InputError


def value_or(content: dict, key: str, usual: dict | list) -> object:
    """Return a key's value; a key without a value counts as left out."""
    value = content.get(key)
    return usual if value is None else value


def read_rows(place: str, value: object, columns: int, what: str) -> np.ndarray:
    """Return float64 [n, columns] from a YAML list of rows of finite numbers."""
    listed = value if isinstance(value, list) else [value]
    for number, row in enumerate(listed, start=1):
        numbers = row if isinstance(row, list) and len(row) == columns else [None]
        if not all(is_finite(one) for one in numbers):
            raise InputError(
                f"{place}: each must be {what} in metres, not {row!s:.200} (number {number})"
            )
    return np.array(listed, float).reshape(-1, columns)


def is_finite(value: object) -> bool:
    """Return whether a value is a number within +-1e9."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return is_number and abs(value) < 1e9


def read_boolean(place: str, value: object) -> bool:
    """Return true or false; raise InputError for any other value."""
    if not isinstance(value, bool):
        raise InputError(f"{place}: {value!r:.200}; must be true or false, without quotes")
    return value


def check_keys(place: str, content: object, known: tuple[str, ...]) -> None:
    """Raise InputError unless the content is a mapping with known keys."""
    if not isinstance(content, dict):
        raise InputError(f"{place}{content!s:.200}; must be keys and values ({', '.join(known)})")
    for key in content:
        if key not in known:
            near = difflib.get_close_matches(str(key), known, n=1)
            hint = f"did you mean {near[0]}?" if near else f"available: {', '.join(known)}"
            raise InputError(f"{place}unknown key {key!s:.80}; {hint}")


def check_choice(place: str, value: object, known: tuple[str, ...]) -> None:
    """Raise InputError unless the value is a known one."""
    if value not in known:
        raise InputError(f"{place}: {value!s:.200}; must be one of {', '.join(known)}")


def read_number(place: str, value: object, low: float, high: float) -> float:
    """Return a number in a range; raise InputError for any other value."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        raise InputError(f"{place}: {value!s:.200}; must be a number in {low:g}..{high:g}")
    return float(value)

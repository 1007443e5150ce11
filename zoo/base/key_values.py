"""Values of a command's keys: typed texts, or values from Python, checked and converted."""

from __future__ import annotations

import functools
import os
import types
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import is_dataclass
from operator import attrgetter
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin

from zoo.base.command_keys import (
    REQUIRED,
    Choice,
    Key,
    Section,
    bounds,
    entry_choice,
    keyed,
    keys_of,
    listed,
    mark_of,
    typed,
    wanted,
)
from zoo.base.errors import InputError, UsageError, hint

Made = TypeVar("Made")

NULLS = ("", "null", "~")


def convert(name: str, kind: Any, value: Any) -> Any:
    """Return a typed text or a value from Python, converted to a key's type.

    >>> convert("fps", int, "24"), convert("out", str | None, "null")
    (24, None)
    >>> convert("track", str, ["lake", "mountain"])
    'lake,mountain'

    True is no number, as it is in Python.

    Raises:
        UsageError: it has the wrong type or range; the message names key, value and range.
    """
    from pydantic import ValidationError

    original = value = None if isinstance(value, str) and value in NULLS else listed(value)
    parts = [getattr(part, "__origin__", part) for part in (*get_args(kind), kind)]
    plain = {get_origin(part) or part for part in parts}
    mark = entry_choice(kind)
    is_named = not mark or value is None or value in mark.own or value in mark.names
    if not is_named or is_misplaced_bool(kind, value):
        raise UsageError(f"{name}={typed(original)}: must be {wanted(kind)}")
    if isinstance(value, str) and plain & {list, tuple}:
        from zoo.base.plain_files import parse_yaml

        try:
            value = parse_yaml(value if value.startswith("[") else f"[{value}]")
        except ValueError:
            raise UsageError(f"{name}={value}: must be a list, such as [1,2]") from None
    if str in plain and isinstance(value, list | os.PathLike | Mapping):
        value = ",".join(map(typed, value if isinstance(value, list) else [value]))
    try:
        return _adapter(kind).validate_python(value)
    except ValidationError as error:
        what = "a finite number" if error.errors()[0]["type"] == "finite_number" else wanted(kind)
        raise UsageError(f"{name}={typed(original)}: must be {what}") from None


def is_misplaced_bool(kind: Any, value: Any) -> bool:
    """Return whether a value has true or false where a type has numbers alone.

    >>> is_misplaced_bool(list[float] | None, [0.5, True]), is_misplaced_bool(bool | float, True)
    (True, False)
    """
    if isinstance(value, list | tuple):
        return any(is_misplaced_bool(kind, part) for part in value)
    kinds = kinds_in(kind)
    return isinstance(value, bool) and bool not in kinds and not kinds.isdisjoint({int, float})


@functools.lru_cache(maxsize=1024)
def kinds_in(kind: Any) -> frozenset[Any]:
    """Return the classes that a type is made of; those of a `Literal`'s values, too.

    >>> sorted(kind.__name__ for kind in kinds_in(dict[str, float] | Literal["a"] | None))
    ['NoneType', 'dict', 'float', 'str']
    """
    if get_origin(kind) is Literal:
        return frozenset(map(type, get_args(kind)))
    if get_origin(kind) is Annotated:
        return kinds_in(get_args(kind)[0])
    origin = get_origin(kind)
    inner = frozenset().union(*(kinds_in(part) for part in get_args(kind)))
    return inner if origin in (Union, types.UnionType) else inner | {origin or kind}


@functools.lru_cache(maxsize=1024)
def _adapter(kind: Any) -> Any:
    """Return pydantic's `TypeAdapter` of a type, which takes a millisecond to make."""
    from pydantic import ConfigDict, TypeAdapter

    if is_dataclass(kind):
        return TypeAdapter(kind)
    return TypeAdapter(kind, config=ConfigDict(coerce_numbers_to_str=True, allow_inf_nan=False))


def constructed(
    function: Callable[..., Any], values: Mapping[str, Any], prefix: str = ""
) -> dict[str, Any]:
    """Return the keyword arguments of a function, with the values of its keys.

    Raises:
        UsageError: a value has the wrong type or range, or a key is missing.
    """
    arguments = {}
    for parameter, kind in keyed(function):
        name = prefix + parameter.name
        mark, inner = mark_of(kind)
        if isinstance(mark, Choice):
            chosen = mark.resolved(name, values)
            arguments[parameter.name] = _made(mark.functions[chosen[name]], chosen, f"{name}.")
        elif mark is not None:
            below = f"{name}." if isinstance(mark, Section) else prefix
            arguments[parameter.name] = _made(inner, values, below)
        elif name in values:
            arguments[parameter.name] = convert(name, kind, values[name])
        elif parameter.default is REQUIRED:
            raise UsageError(f"{name}: not given; add {name}=VALUE")
    return arguments


def _made(make: Callable[..., Made], values: Mapping[str, Any], prefix: str) -> Made:
    try:
        return make(**constructed(make, values, prefix))
    except InputError as error:  # a value that the class refuses
        raise UsageError(str(error)) from None


def check_keys(names: Iterable[str], keys: Iterable[Key], remedy: str = "") -> None:
    """Raise UsageError for a key that does not exist."""
    allowed = [key.name for key in keys]
    for name in names:
        if name not in allowed:
            key, _, value = name.partition(":")
            near = f"write {key}: {value}, with a space" if key in allowed else None
            raise UsageError(f"{name}: no such key; {near or hint(name, allowed, remedy)}")


def check_values(options: object) -> None:
    """Raise UsageError for a value out of the range of its type, or that is no choice of it."""
    kind: Any = type(options)
    for key in _bounded_keys(kind):
        convert(key.name, key.kind, attrgetter(key.name)(options))


@functools.cache
def _bounded_keys(kind: type) -> list[Key]:
    return [key for key in keys_of(kind) if bounds(key.kind)]


def read_texts(
    arguments: Iterable[str], command: str = "", keys: Collection[str] = ()
) -> dict[str, str]:
    """Return the texts of `key=value` arguments by key; `--film` means `film=true`.

    Of the known keys, `data.KEY` means KEY, since messages about a recording name a training's.

    Raises:
        UsageError: a key is repeated or has no value.
    """
    texts: dict[str, str] = {}
    for argument in arguments:
        key, equals, text = argument.partition("=")
        if not equals and not argument.startswith("--"):
            raise UsageError(f"{argument}: no value given; write {argument}=VALUE")
        key = key.lstrip("-").replace("-", "_").removeprefix(f"{command}.")
        key = key if key in keys or key[5:] not in keys else key.removeprefix("data.")
        if key in texts:
            raise UsageError(f"{key}: given twice; give it once")
        texts[key] = text if equals else "true"
    return texts


def read_options(kind: Callable[..., Made], arguments: Sequence[str] = ()) -> Made:
    """Return an instance of a class of options from `key=value` arguments.

    Raises:
        UsageError: a key is unknown, repeated or missing, or a value has the wrong type or range.
    """
    texts = read_texts(arguments)
    check_keys(texts, keys_of(kind, values=texts))
    return kind(**constructed(kind, texts))

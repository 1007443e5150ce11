"""Keys of a command: types, ranges, defaults and meanings from the signature of a function.

A parameter whose annotation is a dataclass gives its fields as keys, which is how commands share
keys.
"""

from __future__ import annotations

import functools
import inspect
import os
import re
import sys
import textwrap
import types
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, is_dataclass
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from zoo.base.entry_points import named_entries
from zoo.base.errors import UsageError, hint
from zoo.base.terminal import command_line

WIDTH, NAMES = 100, 24  # characters of a help line, and of its first column
REQUIRED: Any = inspect.Parameter.empty
_NAMED = {float: "a number", int: "a whole number", bool: "true or false"}
_NAMED |= dict.fromkeys((list, tuple, Sequence), "a list")
SECTION = re.compile(r"^\w+:$", re.MULTILINE)
_ENTRY = re.compile(r"^ {4}([\w, *]+): (.*(?:\n {8}.*)*)", re.MULTILINE)


@dataclass(frozen=True)
class Key:
    """A key of a command.

    Attributes:
        name: dotted name that a user types before `=`.
        kind: type of the value, with its range.
        default: default value; REQUIRED for a key that must be given.
        meaning: meaning and unit.
    """

    name: str
    kind: Any
    default: Any
    meaning: str

    @property
    def typed(self) -> str:
        """Return the default as a user types it."""
        return "needed" if self.default is REQUIRED else typed(self.default)

    @property
    def choices(self) -> tuple[str, ...]:
        """Return the names of all values; none for a key that takes any text or number."""
        return choices_of(self.kind)

    @property
    def row(self) -> str:
        """Return the lines of the help."""
        mark = entry_choice(self.kind)
        limits = (mark.words if mark else bounds(self.kind)).removeprefix("in ").removeprefix("of ")
        explained = all(re.search(rf"\b{name}\b", self.meaning) for name in self.choices)
        meaning = re.sub(r"\bNone\b", "null", self.meaning)
        if limits and not (self.choices and explained):
            meaning += f" ({limits})"
        return help_row(command_line([f"{self.name}={self.typed}"]), meaning)


@dataclass(frozen=True)
class Section:
    """Mark of a key whose type's arguments are keys below it, such as `steering.gain`."""


@dataclass(frozen=True)
class Untyped:
    """Mark of an argument that only programs give, and that is no key."""


@dataclass(frozen=True)
class Choice:
    """Mark of a key that names one of several functions, whose arguments are keys below it.

    Attributes:
        functions: function by name.
        default: name without the key.
        number: argument that a number in place of a name sets.
    """

    functions: Mapping[str, Callable[..., Any]]
    default: str
    number: str

    def resolved(self, name: str, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return the values with a number in place of a name moved to its key.

        Raises:
            UsageError: there is no such choice.
        """
        chosen = values.get(name, self.default)
        if isinstance(chosen, int | float) or re.match(r"[-+]?[\d.]", str(chosen)):
            rest = {key: value for key, value in values.items() if key != name}
            return {name: self.default, f"{name}.{self.number}": chosen} | rest
        if chosen not in self.functions:
            raise UsageError(f"{name}={chosen}: no such choice; {hint(chosen, self.functions)}")
        return {**values, name: chosen}


@dataclass(frozen=True)
class EntryChoice:
    """Mark of a key that names one of drivezoo's choices, or a package's entry point.

    Attributes:
        group: group of the entry points, which are read only for a name that is not drivezoo's.
        own: drivezoo's names.
    """

    group: str
    own: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Return all names, drivezoo's first."""
        return tuple(dict.fromkeys((*self.own, *sorted(named_entries(self.group)))))

    @property
    def words(self) -> str:
        """Return the names as in a sentence."""
        none = f"an entry point of {self.group}, of which none is installed"
        return alternatives(self.names) if self.names else none


def alternatives(names: Iterable[object]) -> str:
    """Return names as in a sentence.

    >>> alternatives(["a", "b", "c"])
    'a, b or c'
    """
    *first, last = map(str, names)
    return f"{', '.join(first)} or {last}" if first else last


def listed(value: Any) -> Any:
    """Return a collection as a list, and any other value, a mapping too, as it is.

    >>> listed(range(2)), listed({"b", "a"}), listed("ab")
    ([0, 1], ['a', 'b'], 'ab')
    """
    is_number = getattr(value, "shape", None) == ()  # of NumPy
    if is_number or isinstance(value, str | bytes | Mapping) or not isinstance(value, Iterable):
        return value
    return sorted(value, key=str) if isinstance(value, set | frozenset) else list(value)


def typed(value: object) -> str:
    """Return a value as users type it; a text stays as it is.

    >>> typed([1, None, "a"]), typed({"fog": 0.4}), typed(True)
    ('[1,null,a]', '{fog: 0.4}', 'true')
    """
    value = listed(value)
    if value is None:
        return "null"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        return f"[{','.join(map(typed, value))}]"
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {typed(each)}" for key, each in value.items()) + "}"
    return str(os.fspath(value) if isinstance(value, os.PathLike) else value)


def changed(options: object) -> list[str]:
    """Return the options that differ from the defaults of their class, as users type them."""
    usual, words = type(options)(), []
    for key, value in vars(options).items():
        if is_dataclass(value):
            words += [f"{key}.{word}" for word in changed(value)]
        elif value != getattr(usual, key):
            words.append(f"{key}={typed(value)}")
    return words


def typed_keys(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    """Yield keys, those of an inner mapping after a dot, with their values as users type them.

    >>> list(typed_keys({"model": "lenet", "data": {"root": "lake", "offset": 0.2}}))
    [('model', 'lenet'), ('data.root', 'lake'), ('data.offset', '0.2')]
    """
    for key, value in values.items():
        if isinstance(value, Mapping):
            yield from typed_keys(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", typed(value)


def help_row(name: str, meaning: str, names: int = NAMES) -> str:
    """Return a name and its meaning in two columns; a long name has its own line.

    Args:
        name: text of the first column.
        meaning: text of the second column, which is wrapped.
        names: width of the first column, characters.
    """
    indent = " " * (names + 2)
    text = textwrap.fill(meaning, WIDTH, initial_indent=indent, subsequent_indent=indent)
    if len(name) >= names:
        return f"  {name}\n{text}".rstrip()
    return f"  {name:<{names}}{text[len(indent) :]}".rstrip()


def bounds(kind: Any) -> str:
    """Describe the limits or choices of a type; empty for a type without any.

    >>> from pydantic import Field
    >>> bounds(Annotated[float, Field(gt=0, le=1000)] | None), bounds(Literal["full", "simple"])
    ('above 0, up to 1000', 'full or simple')
    """
    if get_origin(kind) in (Union, types.UnionType):
        return ", or ".join(filter(None, map(bounds, get_args(kind))))
    if get_origin(kind) is Literal:
        return alternatives(get_args(kind))
    limits: dict[str, float] = {}
    for mark in getattr(kind, "__metadata__", ()):
        for limit in getattr(mark, "metadata", ()):  # of pydantic's Field
            names = ("gt", "ge", "lt", "le")
            limits |= {name: getattr(limit, name) for name in names if hasattr(limit, name)}
    words = [
        f"{word} {limits[name]:g}"
        for name, word in (("gt", "above"), ("lt", "below"), ("le", "up to"))
        if name in limits
    ]
    if "ge" in limits:
        least, most = f"{limits['ge']:g}", limits.get("le", limits.get("lt"))
        words = [f"in {least}..{most:g}" if most is not None else f"of {least} or more"]
    return ", ".join(words)


def wanted(kind: Any) -> str:
    """Describe the values that a type accepts.

    >>> from pydantic import Field
    >>> wanted(Annotated[float, Field(gt=0, le=1000)] | None)
    'a number above 0, up to 1000, or null'
    >>> wanted(tuple[int, float])
    '[a whole number, a number]'
    """
    if get_origin(kind) in (Union, types.UnionType):
        parts = get_args(kind)
        return ", or ".join("null" if part is type(None) else wanted(part) for part in parts)
    if get_origin(kind) is Literal:
        return bounds(kind)
    if mark := entry_choice(kind):
        return mark.words
    plain, *marks = get_args(kind) if get_origin(kind) is Annotated else [kind]
    examples = [example for mark in marks for example in getattr(mark, "examples", None) or ()]
    if examples:
        return f"as in {', '.join(map(typed, examples))}"
    if get_origin(plain) is tuple:
        return f"[{', '.join(map(wanted, get_args(plain)))}]"
    return f"{_NAMED.get(get_origin(plain) or plain, 'text')} {bounds(kind)}".strip()


def choices_of(kind: Any) -> tuple[str, ...]:
    """Return the names of all values of a type; none for a type that takes any text or number."""
    if kind is bool:
        return ("true", "false")
    for mark in getattr(kind, "__metadata__", ()):
        if isinstance(mark, Choice):
            return tuple(mark.functions)
        if isinstance(mark, EntryChoice):
            return mark.names
    if get_origin(kind) is Literal:
        return tuple(map(str, get_args(kind)))
    if get_origin(kind) in (Union, types.UnionType):
        parts = [choices_of(part) for part in get_args(kind) if part is not type(None)]
        return tuple(name for names in parts for name in names) if all(parts) else ()
    return ()


def entry_choice(kind: Any) -> EntryChoice | None:
    """Return the mark of a type, or of a part of a union; None without it."""
    marks = (mark for part in (kind, *get_args(kind)) for mark in getattr(part, "__metadata__", ()))
    return next((mark for mark in marks if isinstance(mark, EntryChoice)), None)


def meanings_of(function: Callable[..., Any]) -> dict[str, str]:
    """Return the meaning of each argument, from the docstrings of a function or of classes."""
    inner = function.func if isinstance(function, functools.partial) else function
    owners = reversed(inner.__mro__[:-1]) if inspect.isclass(inner) else [inner]
    meanings: dict[str, str] = {}
    for owner in owners:
        text = inspect.cleandoc(owner.__doc__ or "")
        for title in ("\nArgs:\n", "\nAttributes:\n"):
            for names, meaning in _ENTRY.findall(SECTION.split(text.partition(title)[2])[0]):
                words = " ".join(meaning.split()).removesuffix(".")
                meanings |= {name.strip(" *"): words for name in names.split(",")}
    return meanings


def keys_of(function: Callable[..., Any], prefix: str = "", values: Any = None) -> list[Key]:
    """Return the keys of a command's function, or of a class that shares keys.

    Args:
        function: function, or a class whose arguments are all keys.
        prefix: text before each name, such as `steering.`.
        values: values by key, of which those of choices decide the keys below them.
    """
    meanings = meanings_of(function)
    keys = []
    for parameter, kind in keyed(function):
        name = prefix + parameter.name
        mark, inner = mark_of(kind)
        if mark is None:
            keys.append(Key(name, kind, parameter.default, meanings.get(parameter.name, "")))
        elif isinstance(mark, Choice):
            chosen = mark.resolved(name, values or {})[name]
            meaning = f"{meanings.get(parameter.name, '')}; one of {', '.join(mark.functions)}"
            keys.append(Key(name, kind, mark.default, meaning))
            keys += keys_of(mark.functions[chosen], f"{name}.")
        else:
            keys += keys_of(inner, f"{name}." if isinstance(mark, Section) else prefix, values)
    return keys


def keyed(function: Callable[..., Any]) -> Iterator[tuple[inspect.Parameter, Any]]:
    """Yield the parameters that are keys, with their types: of a class all, else keyword-only ones.

    Texts of annotations are evaluated.
    """
    inner = function.func if isinstance(function, functools.partial) else function
    hints: dict[str, Any] = {}
    if inspect.isclass(inner):
        owner = inner if is_dataclass(inner) else inner.__init__
        hints = get_type_hints(owner, include_extras=True)
    for parameter in inspect.signature(function).parameters.values():
        if parameter.kind is not parameter.KEYWORD_ONLY and not inspect.isclass(inner):
            continue
        kind = hints.get(parameter.name, parameter.annotation)
        if isinstance(kind, str):
            kind = eval(kind, vars(sys.modules[inner.__module__]))
        if not any(isinstance(mark, Untyped) for mark in getattr(kind, "__metadata__", ())):
            yield parameter, kind


def mark_of(kind: Any) -> tuple[object, Any]:
    """Return the mark of a parameter that holds several keys, and its type; None for one key."""
    for mark in getattr(kind, "__metadata__", ()):
        if isinstance(mark, Choice | Section):
            return mark, get_args(kind)[0]
    return (kind, kind) if is_dataclass(kind) else (None, kind)

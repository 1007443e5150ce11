"""Untrusted JSON and YAML files as plain containers, within bounds."""

import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml

from zoo.base.bounded_files import MOST_JSON_BYTES, MOST_YAML_BYTES, read_text
from zoo.base.errors import InputError, hint
from zoo.base.limits import MOST

MOST_DIGITS = 4300  # of a number; Python's own limit
MOST_GROUPS = 100  # of base 60: YAML 1.1 reads 1:30 as 90
MOST_BITS = 14_280  # of a number with fewer digits

_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_STARTS = (yaml.MappingStartEvent, yaml.SequenceStartEvent)
_ENDS = (yaml.MappingEndEvent, yaml.SequenceEndEvent)
_NUMBER = re.compile(r"[\s_]*[-+0-9.]")
_UNUSABLE = re.compile("[\0\ud800-\udfff]")
# As Python does, a path's bytes that are not UTF-8 are saved as \udc80 to \udcff.
_UNUSABLE_IN_PATHS = re.compile("[\0\ud800-\udc7f\udd00-\udfff]")
_ESCAPED_BYTE = re.compile(r"\\uDC[89A-F]")


def read_json(path: Path) -> object:
    """Return a JSON file's contents.

    Raises:
        InputError: the file cannot be read, is too large or too deep, or is not JSON.
    """
    with _valid(path, "JSON"):
        return check_text(parse_json(read_text(path, MOST_JSON_BYTES)))


def check_version(
    version: object, supported: int, path: object, remedy: str = "use the drivezoo that wrote it"
) -> None:
    """Raise InputError if a file's format version, any value, is not the known one."""
    if type(version) is not int or version != supported:
        shown = " ".join(str(version).split())
        raise InputError(
            f"{path}: has format version {shown:.40}, this drivezoo reads {supported}; {remedy}"
        )


def parse_json(text: str) -> object:
    """Return a JSON text's contents; raise ValueError for any error in it."""
    if sum(map(text.count, ",[{")) > MOST["values"]:  # 5 million empty lists take 300 MB
        raise ValueError(f"has more than {MOST['values']:,} values")
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError(f"nested deeper than {MOST['levels']} levels") from None


def read_like(path: Path, folder: Path) -> object:
    """Return a YAML file's contents; `like: NAME` adds what they leave out from folder/NAME.yaml.

    Raises:
        InputError: as `read_yaml`, or there is no such file in the folder.
    """
    content = read_yaml(path)
    if not isinstance(content, dict) or "like" not in content:
        return content
    name, names = content.pop("like"), sorted(file.stem for file in folder.glob("*.yaml"))
    if name not in names:
        raise InputError(f"{path}: like: {name!a:.80} is not included; {hint(str(name), names)}")
    base = read_yaml(folder / f"{name}.yaml")
    return base | content if isinstance(base, dict) else content


def read_yaml(path: Path, any_path: bool = False) -> object:
    """Return a YAML file's contents; raise as `read_json`, and for aliases and tags.

    Args:
        path: file to read.
        any_path: whether texts may contain paths that are not UTF-8, as Hydra saves them.
    """
    with _valid(path, "YAML"):
        return parse_yaml(read_text(path, MOST_YAML_BYTES), any_path)


def parse_yaml(text: str, any_path: bool = False) -> object:
    """Return a YAML text's contents; raise ValueError for any error in it."""
    check_yaml(text, any_path)
    try:
        return check_text(yaml.load(text, _loader(text, any_path)), any_path)
    except yaml.YAMLError as error:
        raise ValueError(_reason(error)) from None


def check_yaml(text: str, any_path: bool = False) -> None:
    """Raise ValueError for a text that is not YAML, or would take too much time or memory."""
    depth = 0
    try:
        for event in yaml.parse(text, _loader(text, any_path)):
            line = event.start_mark.line + 1
            if isinstance(event, yaml.AliasEvent):  # a few can expand to millions of values
                raise ValueError(f"line {line}: *{event.anchor} is an alias; write its value")
            if getattr(event, "tag", None) is not None:
                raise ValueError(f"line {line}: {event.tag:.80} is a tag; delete it")
            depth += isinstance(event, _STARTS) - isinstance(event, _ENDS)
            if depth > MOST["levels"]:
                raise ValueError(f"line {line}: nested deeper than {MOST['levels']} levels")
            if isinstance(event, yaml.ScalarEvent) and not event.style:
                size = len(event.value)
                is_long = size > MOST_DIGITS or event.value.count(":") > MOST_GROUPS
                if is_long and _NUMBER.match(event.value):
                    raise ValueError(f"line {line}: a number of {size:,} digits")
    except yaml.YAMLError as error:
        raise ValueError(_reason(error)) from None


def check_text(content: object, any_path: bool = False) -> Any:
    """Return plain containers; raise ValueError for too many values or levels, or unusable text.

    A value counts as often as it is reached: lists that share their parts can hold billions.
    """
    unusable = _UNUSABLE_IN_PATHS if any_path else _UNUSABLE
    level, count = [content], 1
    for _ in range(MOST["levels"] + 1):
        if not level:
            return content
        for value in level:
            if isinstance(value, str) and unusable.search(value):
                raise ValueError(f"{value[:40]!a} contains a NUL or half a character")
            if isinstance(value, int) and value.bit_length() > MOST_BITS:
                raise ValueError(f"a number of more than {MOST_DIGITS:,} digits")
        dicts = [value for value in level if isinstance(value, dict)]
        inner = [value for value in level if isinstance(value, list | tuple)]
        count += sum(map(len, inner)) + 2 * sum(map(len, dicts))
        if count > MOST["values"]:
            raise ValueError(f"has more than {MOST['values']:,} values")
        level = [child for sequence in inner for child in sequence]
        level += [child for dictionary in dicts for pair in dictionary.items() for child in pair]
    raise ValueError(f"nested deeper than {MOST['levels']} levels")


def mapped(function: Callable[[Any], Any], value: Any) -> Any:
    """Return plain containers with the function of each value in them.

    >>> mapped(str, {"a": [1, {"b": 2}]})
    {'a': ['1', {'b': '2'}]}
    """
    if isinstance(value, Mapping):
        return {key: mapped(function, item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [mapped(function, item) for item in value]
    return function(value)


def leaves(node: object, keys: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], object]]:
    """Yield each value in plain containers, with its keys.

    >>> list(leaves({"a": [1, {"b": 2}]}))
    [(('a', '0'), 1), (('a', '1', 'b'), 2)]
    """
    if isinstance(node, Mapping):
        pairs: Iterable[tuple[object, object]] = node.items()
    elif isinstance(node, list | tuple):
        pairs = enumerate(node)
    else:
        yield keys, node
        return
    for name, value in pairs:
        yield from leaves(value, (*keys, str(name)))


@contextmanager
def _valid(path: Path, language: str) -> Iterator[None]:
    try:
        yield
    except ValueError as error:
        raise InputError(f"{path}: is not valid {language} ({_reason(error)})") from None


def _loader(text: str, any_path: bool) -> Any:
    """Return the safe loader; the one in C rejects the surrogates of paths, which PyYAML writes."""
    return yaml.SafeLoader if any_path and _ESCAPED_BYTE.search(text) else _LOADER


def _reason(error: Exception) -> str:
    mark = getattr(error, "problem_mark", None)
    if mark is not None:
        return f"line {mark.line + 1}: {getattr(error, 'problem', '')}"
    return " ".join(str(error).split()) or type(error).__name__

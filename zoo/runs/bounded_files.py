"""Read untrusted JSON and YAML as plain containers, with limits on size and depth."""

import json
import re
from pathlib import Path
from typing import Any

import yaml

from datamodules.errors import InputError
from datamodules.regular_file import read_regular

MOST_JSON_BYTES = 16_000_000
MOST_YAML_BYTES = 1_000_000
MOST_LEVELS = 64
MOST_DIGITS = 4300  # of a number; Python's own limit

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
    text = read_text(path, MOST_JSON_BYTES)
    try:
        return check_text(parse_json(text))
    except ValueError as error:
        raise InputError(f"{path}: is not valid JSON ({_reason(error)})") from None


def parse_json(text: str) -> object:
    """Return a JSON text's contents; raise ValueError for any error in it."""
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError(f"nested deeper than {MOST_LEVELS} levels") from None


def read_yaml(path: Path, any_path: bool = False) -> object:
    """Return a YAML file's contents; raise as `read_json`, and for aliases.

    Args:
        path: file to read.
        any_path: whether texts may contain paths that are not UTF-8, as Hydra saves them.
    """
    text = read_yaml_text(path, any_path)
    try:
        return check_text(yaml.load(text, _loader(text, any_path)), any_path)
    except (yaml.YAMLError, ValueError) as error:
        raise InputError(f"{path}: is not valid YAML ({_reason(error)})") from None


def read_yaml_text(path: Path, any_path: bool = False) -> str:
    """Return a YAML file's text after `check_yaml`; raise as `read_yaml`."""
    text = read_text(path, MOST_YAML_BYTES)
    try:
        check_yaml(text, any_path)
    except (yaml.YAMLError, ValueError) as error:
        raise InputError(f"{path}: is not valid YAML ({_reason(error)})") from None
    return text


def check_yaml(text: str, any_path: bool = False) -> None:
    """Raise ValueError for YAML that would take too much time or memory to load."""
    depth = 0
    for event in yaml.parse(text, _loader(text, any_path)):
        line = event.start_mark.line + 1
        if isinstance(event, yaml.AliasEvent):  # a few aliases can expand to millions of values
            raise ValueError(f"line {line}: *{event.anchor} is an alias; write its value instead")
        depth += isinstance(event, _STARTS) - isinstance(event, _ENDS)
        if depth > MOST_LEVELS:
            raise ValueError(f"line {line}: nested deeper than {MOST_LEVELS} levels")
        if isinstance(event, yaml.ScalarEvent) and len(event.value) > MOST_DIGITS:
            quoted = bool(event.style) and event.tag is None
            if not quoted and _NUMBER.match(event.value):
                raise ValueError(f"line {line}: a number of {len(event.value):,} digits")


def read_text(path: Path, most_bytes: int) -> str:
    """Return a file's text; raise InputError if it cannot be read, is too large or not UTF-8."""
    try:
        return read_regular(path, most_bytes).decode("utf-8-sig")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: byte {error.start + 1:,} is not UTF-8") from None


def check_text(found: object, any_path: bool = False) -> Any:
    """Return parsed contents; raise ValueError if they are too deep or hold unusable text."""
    unusable = _UNUSABLE_IN_PATHS if any_path else _UNUSABLE
    level = [found]
    for _ in range(MOST_LEVELS + 1):
        if not level:
            return found
        for one in level:
            if isinstance(one, str) and unusable.search(one):
                raise ValueError(f"{one[:40]!a} contains a NUL or half a character")
        dicts = [one for one in level if isinstance(one, dict)]
        inner = [one for one in level if isinstance(one, list)]
        level = [child for one in inner for child in one]
        level += [child for one in dicts for pair in one.items() for child in pair]
    raise ValueError(f"nested deeper than {MOST_LEVELS} levels")


def _loader(text: str, any_path: bool) -> Any:
    """Return the safe loader; the one in C rejects the surrogates of paths, which PyYAML writes."""
    return yaml.SafeLoader if any_path and _ESCAPED_BYTE.search(text) else _LOADER


def _reason(error: Exception) -> str:
    mark = getattr(error, "problem_mark", None)
    if mark is not None:
        return f"line {mark.line + 1}: {getattr(error, 'problem', '')}"
    return " ".join(str(error).split()) or type(error).__name__

"""A reader of untrusted YAML: plain containers, limited in size and depth."""

import os
import re
import stat
from pathlib import Path

import yaml

from simulator.errors import SimulatorError

MOST_BYTES = 1_000_000
MOST_LEVELS = 64
MOST_DIGITS = 4300  # of one number: Python's own limit for decimal numbers

_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_STARTS = (yaml.MappingStartEvent, yaml.SequenceStartEvent)
_ENDS = (yaml.MappingEndEvent, yaml.SequenceEndEvent)


def read_yaml(path: Path) -> object:
    """Return the content of a YAML file.

    Raises:
        SimulatorError: the file cannot be read, is too large, or is not plain YAML.
    """
    try:
        return parse_yaml(read_bounded(path, "a track's .yaml file"))
    except (yaml.YAMLError, ValueError) as error:
        raise SimulatorError(f"{path}: not YAML: {' '.join(str(error).split())}") from None


def read_bounded(path: Path, what: str) -> str:
    """Return the text of a regular file of limited size; `what` is what the user should give.

    Raises:
        SimulatorError: the file cannot be read, is not a regular one or is too large.
        UnicodeDecodeError: the file is not text.
    """
    try:
        descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
        with os.fdopen(descriptor, "rb") as file:
            found = os.fstat(descriptor)
            if not stat.S_ISREG(found.st_mode):
                raise SimulatorError(f"{path}: not a regular file; give {what}")
            if found.st_size > MOST_BYTES:
                raise SimulatorError(f"{path}: larger than {MOST_BYTES:,} bytes; give {what}")
            return file.read(found.st_size).decode("utf-8-sig")
    except OSError as error:
        raise SimulatorError(f"{path}: {error.strerror or error}") from None


def parse_yaml(text: str) -> object:
    """Return the content of a YAML text; raise the errors of `check_yaml`."""
    check_yaml(text)
    return yaml.load(text, _LOADER)


def check_yaml(text: str) -> None:
    """Check a YAML text before any container is built from it.

    Raises:
        yaml.YAMLError: the text is not YAML.
        ValueError: the text has an alias (a few aliases can expand to millions of values), nests
            too deeply, or has a number with too many digits.
    """
    depth = 0
    for event in yaml.parse(text, _LOADER):
        line = event.start_mark.line + 1
        if isinstance(event, yaml.AliasEvent):
            raise ValueError(f"line {line}: *{event.anchor} is an alias; write its value there")
        depth += isinstance(event, _STARTS) - isinstance(event, _ENDS)
        if depth > MOST_LEVELS:
            raise ValueError(f"line {line}: nested deeper than {MOST_LEVELS} levels")
        if isinstance(event, yaml.ScalarEvent) and len(event.value) > MOST_DIGITS:
            quoted = bool(event.style) and event.tag is None
            if not quoted and re.match(r"[\s_]*[-+0-9.]", event.value):
                raise ValueError(f"line {line}: a number of {len(event.value):,} digits")

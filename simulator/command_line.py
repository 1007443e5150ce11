"""`key=value` arguments into a dataclass of options, and one line for a user's mistake."""

import difflib
import inspect
import os
import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import MISSING, fields
from typing import TypeVar

from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from simulator.early_interrupt import raise_again
from simulator.errors import SimulatorError, UsageError
from simulator.plain_yaml import check_yaml

Options = TypeVar("Options")


def read_options(kind: type[Options], arguments: Sequence[str]) -> Options:
    """An instance of the dataclass `kind` from `key=value` and `--flag` arguments.

    `--relative` stands for `relative=true`, `--sun-angle 40` is not taken: values follow `=`.

    Raises:
        UsageError: no such key, a value of another type, a key given twice or left out.
    """
    names = [field.name for field in fields(kind)]
    given: dict[str, object] = {}
    for argument in arguments:
        key, sign, text = argument.lstrip("-").partition("=")
        key = key.replace("-", "_")
        if key not in names:
            raise UsageError(f"there is no option {key}{_nearest(key, names)}")
        if not sign and not argument.startswith("--"):
            raise UsageError(f"{argument} has no value: write {key}=VALUE")
        if key in given:
            raise UsageError(f"{key} is given twice")
        given[key] = _value(text) if sign else True
    for field in fields(kind):
        if (
            field.name not in given
            and field.default is MISSING
            and field.default_factory is MISSING
        ):
            raise UsageError(f"{field.name} is not given: add {field.name}=VALUE")
    try:
        return OmegaConf.to_object(OmegaConf.merge(OmegaConf.structured(kind), given))
    except OmegaConfBaseException as error:
        raise UsageError(f"{error.full_key}={given.get(error.full_key)}: {error.msg}") from None


def options_help(kind: type) -> str:
    """What a dataclass of options is for, and a line for each: its default, and its meaning, which
    stands under `Args:` in its docstring or in that of a class before it."""
    intro = inspect.getdoc(kind).partition("Args:")[0]
    meanings: dict[str, str] = {}
    for one in reversed(kind.__mro__[:-1]):
        args = inspect.cleandoc(one.__doc__ or "").partition("Args:")[2]
        found = re.findall(r"^ {4}(\w+): (.*(?:\n {8}.*)*)", args, re.MULTILINE)
        meanings |= {name: " ".join(meaning.split()) for name, meaning in found}
    lines = []
    for one in fields(kind):
        default = one.default
        if one.default_factory is not MISSING:
            default = one.default_factory()
        default = "needed" if default is MISSING else _text(default)
        lines.append(f"  {one.name + '=' + default:<22} {meanings.get(one.name, '')}".rstrip())
    return "\n".join([intro.strip(), "", *lines])


def _text(value: object) -> str:
    """As it is typed: true, null, []."""
    if value is None:
        return "null"
    return str(value).lower() if isinstance(value, bool) else str(value)


def run_command(command: Callable[[Sequence[str]], None], arguments: Sequence[str]) -> int:
    """Call `command(arguments)`; the exit status: 0, 130 when stopped; after an error's one
    line 2 for wrong use, else 1."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")  # a terminal may not know every character
    try:
        raise_again()
        command(arguments)
    except SimulatorError as error:
        _print_error(error)
        return 2 if isinstance(error, UsageError) else 1
    except MemoryError:
        print("simulator: not enough memory; end other programs, or choose less", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("simulator: stopped", file=sys.stderr)
        return 130
    except BrokenPipeError:  # the reader has closed the pipe, as `| head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except OSError as error:
        if error.strerror is None:
            raise
        _print_error(f"{error.filename or 'a file'}: {error.strerror}")
        return 1
    return 0


def _print_error(error: object) -> None:
    """Print one line, whose control characters a terminal does not obey."""
    line = " ".join(str(error).split())
    shown = (one if one.isprintable() else ascii(one)[1:-1] for one in line)
    print(f"simulator: {''.join(shown)}", file=sys.stderr)


def _value(text: str) -> object:
    """YAML's reading of a value, where it is one; a path with odd characters stays as it is."""
    try:
        check_yaml(f"value: {text}")
        value = OmegaConf.create(f"value: {text}")["value"]
    except Exception:  # a parser's error for text that is no YAML is no mistake in itself
        return text
    return text if isinstance(value, dict) else value


def _nearest(key: str, names: Sequence[str]) -> str:
    near = difflib.get_close_matches(key, names, n=1)
    return f"; did you mean {near[0]}?" if near else f"; there are {', '.join(names)}"

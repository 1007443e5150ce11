"""Options from `key=value` arguments, their help text, and one-line errors."""

import difflib
import inspect
import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import MISSING, fields
from typing import TypeVar

from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from zoo.base.bounded_files import check_yaml
from zoo.base.early_interrupt import raise_again
from zoo.base.errors import InputError, UsageError
from zoo.base.standard_output import forgiving_output

Options = TypeVar("Options")


def read_options(kind: type[Options], arguments: Sequence[str]) -> Options:
    """Parse `key=value` and `--flag` arguments into an instance of the dataclass `kind`.

    `--relative` means `relative=true`. `--seed 40` is refused, because a value must follow `=`.

    Raises:
        UsageError: a key is unknown, repeated or missing, or a value has the wrong type.
    """
    names = [field.name for field in fields(kind)]
    given: dict[str, object] = {}
    for argument in arguments:
        key, sign, text = argument.lstrip("-").partition("=")
        key = key.replace("-", "_")
        if key not in names:
            raise UsageError(f"{key}: no such key{_nearest(key, names)}")
        if not sign and not argument.startswith("--"):
            raise UsageError(f"{argument}: no value given; write {key}=VALUE")
        if key in given:
            raise UsageError(f"{key}: given twice; give it once")
        given[key] = _value(text) if sign else True
    for field in fields(kind):
        if (
            field.name not in given
            and field.default is MISSING
            and field.default_factory is MISSING
        ):
            raise UsageError(f"{field.name}: not given; add {field.name}=VALUE")
    try:
        return OmegaConf.to_object(OmegaConf.merge(OmegaConf.structured(kind), given))
    except OmegaConfBaseException as error:
        raise UsageError(f"{error.full_key}={given.get(error.full_key)}: {error.msg}") from None


def options_help(kind: type) -> str:
    """Return the help text of a dataclass of options.

    The text is the docstring's introduction, then a line for each option: its default, and its
    meaning from the `Args:` section of the class or of a class that it inherits from.
    """
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
    """Return a value as users type it: true, null, []."""
    if value is None:
        return "null"
    return str(value).lower() if isinstance(value, bool) else str(value)


def run_command(command: Callable[[Sequence[str]], None], arguments: Sequence[str]) -> int:
    """Call `command(arguments)` and return the exit status.

    The status is 0 on success, 1 after an error, 2 after wrong use, and 130 after Ctrl-C.
    """
    try:
        with forgiving_output():
            raise_again()
            command(arguments)
    except InputError as error:
        _print_error(error)
        return 2 if isinstance(error, UsageError) else 1
    except MemoryError:
        print("simulator: not enough memory; close other programs or ask for less", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("simulator: stopped", file=sys.stderr)
        return 130
    except OSError as error:
        if error.strerror is None:
            raise
        _print_error(f"{error.filename or 'a file'}: {error.strerror}")
        return 1
    return 0


def _print_error(error: object) -> None:
    """Print an error as one line, with control characters escaped for the terminal."""
    line = " ".join(str(error).split())
    shown = (one if one.isprintable() else ascii(one)[1:-1] for one in line)
    print(f"simulator: {''.join(shown)}", file=sys.stderr)


def _value(text: str) -> object:
    """Return a value parsed as YAML, or the text itself where it is not YAML, such as a path."""
    try:
        check_yaml(f"value: {text}")
        value = OmegaConf.create(f"value: {text}")["value"]
    except Exception:  # text that is not YAML is taken as a plain string
        return text
    return text if isinstance(value, dict) else value


def _nearest(key: str, names: Sequence[str]) -> str:
    near = difflib.get_close_matches(key, names, n=1)
    return f"; did you mean {near[0]}?" if near else f"; available: {', '.join(names)}"

"""Command line of a command: arguments, then `key=value` options, and `--help`."""

from __future__ import annotations

import sys
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

from zoo.base.errors import UsageError
from zoo.cli.conf_files import Key, command_keys
from zoo.cli.parts import KEY, MEANING

Options = TypeVar("Options")

HELP = ("-h", "--help")
CHECKPOINT = (
    "checkpoint: a .ckpt or .onnx file, a run's folder, latest, or a network that comes with "
    "drivezoo, such as lenet"
)
WIDTH, NAMES = 100, 24  # characters of a help line, and of its first column


def is_help(arguments: Sequence[str]) -> bool:
    """Return whether one of the arguments asks for help."""
    return not set(HELP).isdisjoint(arguments)


@dataclass(frozen=True)
class Command:
    """A command: its usage, arguments and options.

    Args:
        doc: docstring of the command's module: usage in backticks, purpose, then sentences.
        arguments: meaning of each argument before the options, by its name; `[NAME]` is optional,
            `NAME...` takes several.
    """

    doc: str
    arguments: dict[str, str] = field(default_factory=dict)

    @property
    def usage(self) -> str:
        """Return the command line with placeholders."""
        return self.doc.partition("`")[2].partition("`")[0]

    @property
    def name(self) -> str:
        """Return the command's name, which is also the name of its YAML file."""
        return self.usage.split()[1]

    def options(self) -> list[Key]:
        """Return the options in the command's YAML file; an empty list without such a file."""
        return command_keys(self.name)

    def help(self) -> str:
        """Return the help text: usage, purpose, and a line for each argument and key."""
        purpose = self.doc.partition("`: ")[2].strip()
        rows = [help_row(name, meaning) for name, meaning in self.arguments.items()]
        keys = [help_row(f"{one.name}={one.default}", one.comment) for one in self.options()]
        keys += [help_row(f"{KEY}=null", MEANING)] if keys else []
        parts = [f"usage: {self.usage}", purpose[:1].upper() + purpose[1:]]
        return "\n\n".join([*parts, *("\n".join(one) for one in (rows, keys) if one)])

    def print_help_if_asked(self, given: Sequence[str]) -> None:
        """Print the help and exit if an argument is `--help` or `-h`."""
        if is_help(given):
            print(self.help())
            sys.exit(0)

    def split(self, given: Sequence[str]) -> tuple[list[str], list[str]]:
        """Return the arguments, unparsed, and the options after them.

        Print the help and exit if `--help` is given.

        Raises:
            UsageError: an argument is missing, or there are too many arguments.
        """
        self.print_help_if_asked(given)
        needed = sum(not name.startswith("[") for name in self.arguments)
        several = needed < len(self.arguments) or any("..." in one for one in self.arguments)
        if len(given) < needed:
            raise UsageError(f"usage: {self.usage}; --help lists the options")
        first, rest = list(given[:needed]), list(given[needed:])
        known = {one.name for one in self.options()}
        for one, name in zip(first, self.arguments, strict=False):
            key = one.partition("=")[0].removeprefix(f"{self.name}.")
            if one.startswith("--") or ("=" in one and key in known and not _exists(one)):
                raise UsageError(f"{one}: {name} comes first; usage: {self.usage}")
        options = [one for one in rest if not several or _is_option(one)]
        surplus = [one for one in options if not _is_option(one) or not known]
        if surplus:
            what = "options" if _is_option(surplus[0]) else f"{'further ' * bool(needed)}arguments"
            raise UsageError(f"{surplus[0]}: {self.name} takes no {what}; usage: {self.usage}")
        return first + [one for one in rest if one not in options], options

    def without_config_keys(self, options: Sequence[str]) -> tuple[list[str], list[str]]:
        """Separate the command's own options from options of a config, such as `data.root=x`.

        Returns:
            The command's own options, and the options whose key has a dot or a slash.
        """
        keys = [one.partition("=")[0].removeprefix(f"{self.name}.") for one in options]
        config = [{".", "/"} & set(key) != set() for key in keys]
        own = [one for one, other in zip(options, config, strict=True) if not other]
        return own, [one for one, other in zip(options, config, strict=True) if other]

    def read(self, given: Sequence[str], kind: type[Options]) -> tuple[list[str], Options]:
        """Return the arguments, unparsed, and the composed and checked options.

        Raises:
            UsageError: see `split` and `zoo.cli.command_config.read_options`.
        """
        paths, options = self.split(given)
        from zoo.cli.command_config import read_options  # slow import: Hydra

        return paths, read_options(self.name, kind, options)


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


def _is_option(argument: str) -> bool:
    return argument.startswith("--") or ("=" in argument and not _exists(argument))


def _exists(argument: str) -> bool:
    try:
        return Path(argument).expanduser().exists()
    except (OSError, RuntimeError, ValueError):  # path too long, unknown user, null byte
        return False

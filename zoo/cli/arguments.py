"""Arguments of commands that take paths first and `key=value` options after them, and `--help`."""

import sys
from collections.abc import Sequence
from types import ModuleType
from typing import TypeVar

from datamodules.errors import UsageError

Options = TypeVar("Options")

HELP = ("-h", "--help")


def read_arguments(
    kind: type[Options], paths: Sequence[str], arguments: Sequence[str], usage: str
) -> tuple[list[str], Options]:
    """As many paths as `paths` names, taken as they stand, and the options after them.

    `--help` prints the usage and the options, as `kind`'s docstring has them, and ends the process.

    >>> from dataclasses import dataclass
    >>> @dataclass
    ... class FilmOptions:
    ...     fps: float = 15.0
    >>> read_arguments(FilmOptions, ["FOLDER"], ["my=folder", "fps=48"], "film FOLDER [fps=48]")
    (['my=folder'], FilmOptions(fps=48.0))

    Raises:
        UsageError: a path is missing; see `simulator.command_line.read_options` for the rest.
    """
    from simulator.command_line import options_help, read_options
    from simulator.errors import SimulatorError

    if is_help(arguments):
        print(f"usage: {usage}\n\n{options_help(kind)}")
        sys.exit(0)
    if len(arguments) < len(paths):
        raise UsageError(f"usage: {usage}; --help lists the options")
    try:
        return list(arguments[: len(paths)]), read_options(kind, arguments[len(paths) :])
    except SimulatorError as error:
        raise UsageError(f"{error} (usage: {usage})") from None


def is_help(arguments: Sequence[str]) -> bool:
    """Whether help is asked for, anywhere in the arguments."""
    return not set(HELP).isdisjoint(arguments)


def shown_help(arguments: Sequence[str], usage: str, options: ModuleType) -> bool:
    """Whether help was asked for, which is then printed: the usage and the options of a module.

    Raises:
        UsageError: there are no arguments at all.
    """
    from simulator.__main__ import help_text

    if not arguments:
        raise UsageError(f"usage: {usage}; --help lists the options")
    if not is_help(arguments):
        return False
    print(f"usage: {usage}\n\n{help_text(options)}")
    return True

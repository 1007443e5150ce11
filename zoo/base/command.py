"""A command is a typed function: its signature gives arguments and keys, its docstring the help.

>>> @command
... def film(folder: str, *, fps: float | None = None) -> str:
...     '''Film a drive.
...
...     Args:
...         folder: folder of a drive.
...         fps: frames per second; null: as fast as it was driven.
...     '''
...     return f"{folder} at {fps}"
>>> film("laps", fps=24), film.usage
('laps at 24.0', 'drivezoo film FOLDER [key=value ...]')

Positional parameters are arguments, keyword-only ones are keys. A parameter whose annotation is a
dataclass gives its fields as keys, which is how commands share keys.
"""

from __future__ import annotations

import functools
import inspect
import os
from collections.abc import Callable, Mapping, Sequence
from itertools import takewhile
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar, overload, runtime_checkable

from zoo.base import command_keys, key_values
from zoo.base.errors import InputError, UsageError, hint
from zoo.base.output_files import overwriting
from zoo.base.parts import MEANING as PARTS
from zoo.base.run_command import exit_after

Made = TypeVar("Made")

HELP = ("-h", "--help")
OVERWRITE = command_keys.Key(
    "overwrite", bool, False, "true: replace output files that exist, but no input"
)
MOST_NAMED = 3  # choices that stand in the usage themselves, such as push|pull


class Shown:
    """Base of results that a command prints in a shell, and returns in Python."""

    @property
    def problem(self) -> str:
        """Return what makes the result invalid, such as steering NaN; empty if nothing does."""
        return ""

    def show(self) -> None:
        """Print the result, the files that were written, and the next command."""


class Command(Generic[Made]):
    """A typed function as a command of the shell, and as a checked function of Python.

    Args:
        function: function to call. A result that is `Shown` is printed in a shell.
        name: words after `drivezoo`; the function's name without it.
        parts: whether the command takes `parts=`.
        outputs: whether it writes files that the user names, and takes `overwrite=`.
        config: whether keys of a training's config, which have a dot or a slash, are passed as
            typed in the function's `*overrides`.
    """

    def __init__(
        self,
        function: Callable[..., Made],
        name: str = "",
        parts: bool = True,
        outputs: bool = False,
        config: bool = False,
    ) -> None:
        functools.update_wrapper(self, function)
        self.function, self.parts, self.outputs, self.config = function, parts, outputs, config
        self.name = name or function.__name__

    def __call__(self, *arguments: Any, **keywords: Any) -> Made:
        """Check the values of the keys, call the function and return its result.

        Raises:
            UsageError: a key is unknown, or a value has the wrong type or range.
            InputError: see the function; or its result has a problem.
        """
        # Arguments may have names, too: those of the signature, or `driver` for a checkpoint.
        keys = ["ckpt" if name == "driver" else name for name in keywords]
        names = [*inspect.signature(self.function).parameters][: len(self.arguments)]
        given = [*names[: len(arguments)], *keys]
        if twice := [name for name in keys if given.count(name) > 1]:
            raise UsageError(f"{twice[0]}: given twice; give it once")
        words = dict(zip(keys, keywords.values(), strict=True))
        named = [words.pop(name) for name in takewhile(words.__contains__, names[len(arguments) :])]
        plain = [
            os.fspath(argument) if isinstance(argument, os.PathLike) else argument
            for argument in (*arguments, *named)
        ]
        needed = [name for name in self.arguments if name[0] != "["]
        if len(plain) < len(needed):
            raise UsageError(f"{self.name}: not given: {', '.join(needed[len(plain) :])}")
        is_open = self.config or any("..." in name for name in self.arguments)
        if not is_open and len(plain) > len(self.arguments):
            raise UsageError(f"{plain[-1]!s:.80}: {self.name} takes no further arguments")
        return self._checked(self._run(plain, self._flat(words)))

    def main(self, words: Sequence[str]) -> None:
        """Run the command with the arguments of a shell."""
        if is_help(words):
            print(self.help(words))
            return
        arguments, options = self.split(words)
        options, overrides = self._own(options)
        texts = key_values.read_texts(options, self.name, {key.name for key in self.keys})
        result = self._run([*arguments, *overrides], texts)
        if isinstance(result, Shown):
            result.show()
        self._checked(result)

    def run(self) -> None:
        """Run the command with the arguments of this process, and exit with its status."""
        exit_after(f"drivezoo {self.name}", self.main)

    @property
    def doc(self) -> str:
        """Return the docstring without its sections."""
        return command_keys.SECTION.split(inspect.cleandoc(self.function.__doc__ or ""))[0].strip()

    @property
    def purpose(self) -> str:
        """Return the first sentence of the docstring."""
        return " ".join(self.doc.partition("\n\n")[0].split())

    @functools.cached_property
    def arguments(self) -> dict[str, inspect.Parameter]:
        """Return the parameters before the keys by their placeholder in the usage.

        `folder, *folders` is `FOLDER...`, of which one is needed.
        """
        parameters: dict[str, inspect.Parameter] = {}
        for parameter in inspect.signature(self.function).parameters.values():
            is_several = parameter.kind is parameter.VAR_POSITIONAL
            if parameter.kind is parameter.KEYWORD_ONLY or (self.config and is_several):
                continue
            name = _placeholder(parameter)
            if is_several and name == f"[{next(reversed(parameters), '')}S...]":
                first, parameter = parameters.popitem()
                name = f"{first}..."
            parameters[name] = parameter
        return parameters

    @functools.cached_property
    def keys(self) -> list[command_keys.Key]:
        """Return the keys, of choices those below the default one."""
        return self._keys({})

    def _keys(self, values: Mapping[str, Any]) -> list[command_keys.Key]:
        """Return the keys; the given values of choices decide the keys below them."""
        return command_keys.keys_of(self.function, values=values) + [OVERWRITE] * self.outputs

    @property
    def usage(self) -> str:
        """Return the command line with placeholders."""
        options = ["[key=value ...]"] if self.keys or self.config else []
        return " ".join(["drivezoo", self.name, *self.arguments, *options])

    def help(self, words: Sequence[str] = ()) -> str:
        """Return the help text: usage, purpose, and a line for each argument and key.

        Args:
            words: arguments of the shell, of which choices decide the keys below them.
        """
        meanings = command_keys.meanings_of(self.function)
        rows = [
            command_keys.help_row(placeholder, meanings.get(parameter.name, ""))
            for placeholder, parameter in self.arguments.items()
        ]
        values = dict(argument.split("=", 1) for argument in words if "=" in argument)
        keys = [key.row for key in self._keys(values)]
        if keys and self.parts:
            keys.append(command_keys.help_row("parts=null", PARTS))
        blocks = [f"usage: {self.usage}", self.doc, "\n".join(rows), "\n".join(keys)]
        return "\n\n".join(filter(None, blocks))

    def split(self, words: Sequence[str]) -> tuple[list[str], list[str]]:
        """Return the arguments, unparsed, and the options after them.

        Raises:
            UsageError: an argument is missing or unknown, or there are too many.
        """
        needed = [name for name in self.arguments if name[0] != "["]
        if len(words) < len(needed):
            raise UsageError(f"usage: {self.usage}; --help lists the options")
        first, rest = list(words[: len(needed)]), list(words[len(needed) :])
        keys = {key.name for key in self.keys}
        for argument, name in zip(first, needed, strict=True):
            key = argument.partition("=")[0].removeprefix(f"{self.name}.")
            if argument.startswith("--") or (_is_option(argument) and key in keys):
                raise UsageError(f"{argument}: {name} comes first; usage: {self.usage}")
        options = [argument for argument in rest if _is_option(argument)]
        arguments = first + [argument for argument in rest if argument not in options]
        surplus = [] if keys or self.config else options
        if not any("..." in name for name in self.arguments):
            surplus = surplus + arguments[len(self.arguments) :]
        if surplus and (keys or not self.config):
            what = f"{'further ' * bool(self.arguments)}arguments"
            what = "options" if _is_option(surplus[0]) else what
            raise UsageError(f"{surplus[0]}: {self.name} takes no {what}; usage: {self.usage}")
        return arguments, options

    def _own(self, options: list[str]) -> tuple[list[str], list[str]]:
        """Separate the command's own options from those of a training's config."""
        if not self.config:
            return options, []
        overrides = []
        for option in options:
            key = option.partition("=")[0].removeprefix(f"{self.name}.")
            if not self.keys or "." in key or "/" in key:
                overrides.append(option)
        return [option for option in options if option not in overrides], overrides

    def _run(self, arguments: Sequence[Any], values: Mapping[str, Any]) -> Made:
        parameters = [*self.arguments.values()]
        for number, argument in enumerate(arguments[: None if parameters else 0]):
            parameter = parameters[min(number, len(parameters) - 1)]
            if parameter.annotation in (str, str | Path) and not isinstance(argument, str):
                raise UsageError(
                    f"{argument!r:.80}: is no path; name each file or folder as an argument"
                )
            choices = command_keys.choices_of(parameter.annotation)
            if choices and argument not in choices:
                raise UsageError(
                    f"{argument}: no such {parameter.name}; {hint(argument, choices)}; "
                    f"usage: {self.usage}"
                )
        keys = self._keys(values)
        names = {key.name for key in keys}
        # What a recording means has the same keys in all commands, here without `data.`, too.
        values = {
            f"data.{name}" if name not in names and f"data.{name}" in names else name: value
            for name, value in values.items()
        }
        key_values.check_keys(values, keys, f"drivezoo {self.name} --help lists all")
        keywords = key_values.constructed(self.function, values)
        with overwriting(key_values.convert("overwrite", bool, values.get("overwrite", False))):
            return self.function(*arguments, **keywords)

    def _flat(self, keywords: Mapping[str, Any]) -> dict[str, Any]:
        """Return keywords with `steering={"gain": 2}` as `steering.gain`."""
        parents = {key.name.partition(".")[0] for key in self.keys if "." in key.name}
        values: dict[str, Any] = {}
        for name, value in keywords.items():
            if name in parents and isinstance(value, Mapping):
                values |= {f"{name}.{key}": each for key, each in value.items()}
            else:
                values[name] = value
        return values

    def _checked(self, result: Made) -> Made:
        if isinstance(result, Shown) and result.problem:
            raise InputError(result.problem)
        return result


@overload
def command(function: Callable[..., Made]) -> Command[Made]: ...


@overload
def command(
    *, name: str = "", parts: bool = True, outputs: bool = False, config: bool = False
) -> Callable[[Callable[..., Made]], Command[Made]]: ...


def command(function: Any = None, **settings: Any) -> Any:
    """Make a function a command; see `Command` for the settings."""
    if function is not None:
        return Command(function)
    return lambda decorated: Command(decorated, **settings)


@runtime_checkable
class Comparison(Protocol):
    """A comparison of other programs' files: a module with these names.

    Attributes:
        compare: command.
    """

    compare: Command[Any]

    def detect(self, files: Sequence[str | Path]) -> bool:
        """Return whether the command compares these files."""


def is_help(arguments: Sequence[str]) -> bool:
    """Return whether one of the arguments asks for help."""
    return not set(HELP).isdisjoint(arguments)


def _placeholder(parameter: inspect.Parameter) -> str:
    choices = command_keys.choices_of(parameter.annotation)
    name = "|".join(choices) if 0 < len(choices) <= MOST_NAMED else parameter.name.upper()
    if parameter.kind is parameter.VAR_POSITIONAL:
        return f"[{name}...]"
    return name if parameter.default is parameter.empty else f"[{name}]"


def _is_option(argument: str) -> bool:
    return argument.startswith("--") or ("=" in argument and not is_path(argument))


def is_path(argument: str) -> bool:
    """Return whether an argument is an existing file or folder."""
    try:
        return argument != "" and Path(argument).expanduser().exists()
    except (OSError, RuntimeError, ValueError):  # path too long, unknown user, null byte
        return False

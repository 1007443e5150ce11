"""Console script `drivezoo COMMAND [argument] [key=value ...]`."""

import ast
import shlex
import sys
from pathlib import Path

from zoo.base.errors import InputError
from zoo.base.module_start import run_module
from zoo.base.standard_output import forgiving_output
from zoo.base.terminal import error_line
from zoo.cli.nearest import hint
from zoo.cli.version import FLAGS, version_line

PACKAGE = Path(__file__).parents[1]
# Commands whose name is not that of a file in zoo.
OTHERS = {"train": "zoo", "check": "datamodules.check", "simulator": "simulator"}
# Kinds of `zoo.list`: drivezoo tracks is drivezoo list tracks; drivezoo models is a command.
LISTED = (
    "augmentations",
    "callbacks",
    "checkpoints",
    "losses",
    "optimizers",
    "recipes",
    "roads",
    "schedules",
    "suites",
    "tracks",
)
HELP = ("-h", "--help", "help")
CLOSING = (
    "first steps: drivezoo doctor; drivezoo train experiment=first_try data.root=FOLDER",
    "help on a command: drivezoo COMMAND --help; drivezoo --version",
)
WRONG_USE = 2  # as in zoo.cli.run_command, whose import is slower


def main() -> int:
    """Run the command that the first argument names, as `python -m zoo.COMMAND` does."""
    name, *rest = sys.argv[1:] or ["--help"]
    modules = commands()
    if name in HELP:
        return _print(help_text(modules))
    if name in FLAGS:
        return _print(version_line())
    if name in LISTED:
        name, rest = "list", [name, *rest]
    if name not in modules:
        near = hint(name, modules, "drivezoo --help lists all")
        if "=" in name:  # keys of a training without its name
            near = f"did you mean drivezoo train {shlex.join([name, *rest])}?"
        print(f"drivezoo: {name!a}: no such command; {near}", file=sys.stderr)
        return WRONG_USE
    run_module(modules[name], rest)
    return 0


def _print(text: str) -> int:
    """Print a text, and return the exit status."""
    try:
        with forgiving_output():
            print(text)
    except InputError as error:
        print(error_line("drivezoo", error), file=sys.stderr)
        return 1
    return 0


def commands() -> dict[str, str]:
    """Return the module that `python -m` runs for each command, by the command's name."""
    files = [
        path for path in PACKAGE.glob("*.py") if "__main__" in path.read_text(encoding="utf-8")
    ]
    names = [path.stem for path in files if not path.stem.startswith("__")]
    names += [path.parent.name for path in PACKAGE.glob("*/__main__.py")]
    return OTHERS | {name: f"zoo.{name}" for name in sorted(names)}


def help_text(modules: dict[str, str]) -> str:
    """Return the usage, and each command's purpose from the first line of its docstring."""
    lines = [f"  {name:<12}{_purpose(module)}" for name, module in modules.items()]
    usage = "usage: drivezoo COMMAND [argument] [key=value ...]"
    return "\n".join([usage, "", *lines, "", *CLOSING])


def _purpose(module: str) -> str:
    place = PACKAGE.parent.joinpath(*module.split("."))
    path = place / "__main__.py" if place.is_dir() else place.with_suffix(".py")
    first = (ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "").partition(
        "\n\n"
    )[0]
    return " ".join(first.split()).rpartition("`: ")[2].rstrip(".")

"""Console script `drivezoo COMMAND [argument] [key=value ...]`."""

import ast
import os
import shlex
import subprocess
import sys
from pathlib import Path

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
        try:
            print(help_text(modules), flush=True)
        except BrokenPipeError:  # the reading program closed the pipe, as `| head` does
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    if name in FLAGS:
        print(version_line())
        return 0
    if name in LISTED:
        name, rest = "list", [name, *rest]
    if name not in modules:
        near = hint(name, modules, "drivezoo --help lists all")
        if "=" in name:  # keys of a training without its name
            near = f"did you mean drivezoo train {shlex.join([name, *rest])}?"
        print(f"drivezoo: {name!a}: no such command; {near}", file=sys.stderr)
        return WRONG_USE
    command = [sys.executable, "-m", modules[name], *rest]
    if os.name == "posix":
        os.execv(sys.executable, command)
    return subprocess.call(command)  # on Windows, exec returns before the command ends


def commands() -> dict[str, str]:
    """Return the module that `python -m` runs for each command, by the command's name."""
    files = [path for path in PACKAGE.glob("*.py") if "__main__" in path.read_text()]
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
    first = (ast.get_docstring(ast.parse(path.read_text())) or "").partition("\n\n")[0]
    return " ".join(first.split()).rpartition("`: ")[2].rstrip(".")

"""Console script `drivezoo COMMAND [argument] [key=value ...]`."""

import ast
import functools
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from zoo.base.entry_points import file_of, find_entry, is_extra, load_entry, named_entries, usable
from zoo.base.errors import InputError, UsageError, hint
from zoo.base.module_start import run_module
from zoo.base.run_command import run_command
from zoo.base.terminal import command_line, printable, take_verbosity

if TYPE_CHECKING:
    from zoo.base.command import Command

# Commands, by what a user is doing: of the core, and of the extras that are there.
GROUPS = {
    "recordings": ("check", "edit", "convert", "preview"),
    "training": ("train", "correct", "import"),
    "driving": ("drive", "simulator", "film"),
    "judging": (
        *("evaluate", "benchmark", "compare", "grade", "search", "timing"),
        *("leaderboard", "report", "saliency"),
    ),
    "sharing": ("export", "hub"),
    "drivezoo itself": ("studio", "demo", "list", "new", "doctor", "completion"),
}
# Further names, which belong to a command above: export doubt; evaluate replay=RECORDING;
# train rerun=RUN; the leaderboard as Markdown; train resume=SWEEP.
ALIASES = ("doubt", "replay", "rerun", "results", "sweep")
# Functions of commands that have another name.
FUNCTIONS = {"train": "train_or_sweep", "list": "list_parts"}
SWEEP_RECORD = "sweep.json"  # as zoo.training.sweep_record
ENTRY_POINTS = "drivezoo.commands"
CHALLENGES = "drivezoo.challenges"
# Kinds of `drivezoo list`: drivezoo tracks is drivezoo list tracks. A kind has its group in `conf`,
# if it has one, and how a user types a choice.
LISTED = {
    "models": ("model", "model=NAME"),
    "augmentations": ("augment", '"augment=[NAME,NAME]"'),
    "losses": ("loss", "loss=NAME"),
    "optimizers": ("optim", "optim=NAME"),
    "schedules": ("schedule", "schedule=NAME"),
    "callbacks": ("callbacks", "callbacks=NAME"),
    "recipes": ("experiment", "experiment=NAME"),
    "tracks": ("track", "track=NAME"),
    "roads": ("road", "track=NAME:NUMBER"),
    "suites": ("suite", "suite=NAME"),
    "checkpoints": ("", "drivezoo drive NAME sim=lake"),
    "metrics": ("", ""),
}
HELP = ("-h", "--help", "help")
CLOSING = (
    "first steps: drivezoo doctor; drivezoo train experiment=first_try data.root=FOLDER",
    "help on a command: drivezoo COMMAND --help; drivezoo --version",
)


def main() -> int:
    """Run the command that the first argument names, as `python -m zoo.commands.COMMAND` does."""
    name, *rest = take_verbosity(sys.argv[1:]) or ["--help"]
    if name in LISTED:
        name, rest = "list", [name, *rest]
    name, rest = as_typed_below(name, rest)
    if target := place_of(name):
        run_module(target.partition(":")[0], rest)
        return 0
    outside = {} if name in HELP else outside_commands()
    if name in outside:
        return run_command(f"drivezoo {name}", lambda words: load(outside[name]).main(words), rest)
    return run_command("drivezoo", lambda words: _help_or_hint(words, outside), [name, *rest])


def _help_or_hint(arguments: list[str], outside: Iterable[str]) -> None:
    name, *_ = arguments
    if name in HELP:
        print(help_text())
        return
    near = hint(name, [*commands(), *outside], "drivezoo --help lists all")
    if "=" in name:  # keys of a training without its name
        near = f"did you mean drivezoo train {command_line(arguments)}?"
    raise UsageError(f"{name!a}: no such command; {near}")


def as_typed_below(name: str, rest: list[str]) -> tuple[str, list[str]]:
    """Return the older command and its arguments for what is typed below another command.

    >>> as_typed_below("train", ["rerun=run"])
    ('rerun', ['run'])
    """
    if (name, rest[:1]) == ("export", ["doubt"]):
        return "doubt", rest[1:]
    for word in rest if name == "train" and set(HELP).isdisjoint(rest) else ():
        key, _, folder = word.partition("=")
        if key == "rerun":
            return "rerun", [folder, *(other for other in rest if other is not word)]
        if key == "resume" and Path(folder, SWEEP_RECORD).is_file():
            return "sweep", rest
    return name, rest


def commands() -> dict[str, str]:
    """Return the module that `python -m` runs for each command, by the command's name."""
    return {name: target.partition(":")[0] for name, target in places().items()}


def places() -> dict[str, str]:
    """Return the place of each command of drivezoo, by the command's name, in order of the help."""
    names = [name for group in (*GROUPS.values(), ALIASES) for name in group]
    return {name: target for name in names if (target := place_of(name))}


def place_of(name: str) -> str | None:
    """Return the place of a command: a file of `zoo/commands`, or the entry point of an extra."""
    if name not in {*ALIASES, *(name for group in GROUPS.values() for name in group)}:
        return None
    target = f"zoo.commands.{name}:{FUNCTIONS.get(name, name)}"
    return target if file_of(target).is_file() else extra_commands().get(name)


@functools.cache
def extra_commands() -> dict[str, str]:
    """Return the places of the extras' commands, by the command's name."""
    entries = named_entries(ENTRY_POINTS).values()
    return {each.name: each.value for each in entries if is_extra(each) and "." not in each.name}


def outside_commands() -> dict[str, str]:
    """Return the place of each command of other installed packages, by the command's name."""
    internal = {*commands(), *LISTED, *extra_commands()}
    entries = named_entries(ENTRY_POINTS).items()
    return {name: each.value for name, each in entries if name not in internal and "." not in name}


def commands_below(name: str) -> dict[str, "Command[Any]"]:
    """Return the usable commands of packages below one of drivezoo's, by the last word."""
    from zoo.base.command import Command

    entries, start = named_entries(ENTRY_POINTS).values(), f"{name}."
    below = (entry for entry in entries if entry.name.startswith(start))
    return {word.removeprefix(start): command for word, command in usable(below, Command)}


def challenge_command(name: str) -> "Command[Any]":
    """Return the command of `drivezoo evaluate challenge=NAME`: a test that other people published.

    Its arguments are a checkpoint and the test's folder; it has keys of its own.

    Raises:
        UsageError: there is no such test.
        InputError: a package's command cannot be imported.
    """
    return load(find_entry(CHALLENGES, name, "challenge=").value)


def load(entry: str) -> "Command[Any]":
    """Return the command at `module:function`.

    Raises:
        InputError: it cannot be imported, or is no command.
    """
    from importlib.metadata import EntryPoint  # slow imports

    from zoo.base.command import Command

    return load_entry(EntryPoint(entry.rpartition(":")[2], entry, ENTRY_POINTS), Command)


def help_text() -> str:
    """Return the usage, and each command's purpose from its docstring, by group."""
    targets, lines = places(), ["usage: drivezoo COMMAND [argument] [key=value ...]"]
    for title, group in GROUPS.items():
        rows = [f"  {name:<12}{_purpose(targets[name])}" for name in group if name in targets]
        lines += ["", title, *rows]
    if outside := outside_commands():
        lines += ["", "installed packages"]
        lines += [f"  {name:<12}{_outside_purpose(target)}" for name, target in outside.items()]
    return "\n".join([*lines, "", *CLOSING])


def _purpose(target: str) -> str:
    """Return the first line of a function's docstring, without importing its module."""
    name = target.partition(":")[2]
    return _shortened(written_docstring(file_of(target), name).partition("\n\n")[0])


def written_docstring(path: Path, name: str) -> str:
    """Return the docstring of a function or class in a file, which is not imported."""
    nodes = ast.parse(path.read_text(encoding="utf-8")).body
    documented = (node for node in nodes if isinstance(node, ast.FunctionDef | ast.ClassDef))
    return next((ast.get_docstring(node) or "" for node in documented if node.name == name), "")


def _outside_purpose(target: str) -> str:
    try:
        return printable(_shortened(load(target).purpose))
    except InputError as error:
        return printable(str(error))


def _shortened(sentence: str) -> str:
    sentence = " ".join(sentence.split())
    return sentence[:1].lower() + sentence[1:].rstrip(".")


if __name__ == "__main__":  # a child process runs any command
    sys.exit(main())

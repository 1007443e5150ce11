"""`drivezoo list [KIND]`: list networks, tracks, augmentations, losses, recipes and suites.

Prints each choice with a description. `parts=my_net.py` adds your own.
"""

import ast
import importlib.util
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from zoo.base.errors import UsageError
from zoo.base.terminal import printable
from zoo.checkpoints.checkpoint_path import packaged_names, read_facts
from zoo.cli.closing_lines import print_next
from zoo.cli.command import Command, help_row
from zoo.cli.conf_files import choice_files
from zoo.cli.nearest import hint
from zoo.cli.parts import part_of
from zoo.cli.run_command import run_command

# By kind: its group in `conf`, and how a user types a choice.
KINDS = {
    "models": ("model", "model=NAME"),
    "augmentations": ("augment", "augment=[NAME,NAME]"),
    "losses": ("loss", "loss=NAME"),
    "optimizers": ("optim", "optim=NAME"),
    "schedules": ("schedule", "schedule=NAME"),
    "callbacks": ("callbacks", "callbacks=NAME"),
    "recipes": ("experiment", "experiment=NAME"),
    "tracks": ("track", "track=NAME"),
    "roads": ("road", "track=NAME:NUMBER"),
    "suites": ("suite", "suite=NAME"),
}
CHECKPOINTS = "checkpoints"  # networks that come trained
COMMAND = Command(__doc__, {"[KIND]": ", ".join([*KINDS, CHECKPOINTS])})
OWN = ("zoo", "datamodules")
_USAGE = re.compile(r"(@package|python -m|drivezoo|pip install) ")
_TARGET = re.compile(r"^\s*_target_: *(\S+)", re.MULTILINE)


def print_choices(arguments: list[str]) -> None:
    """Print the choices of a kind, or of every kind.

    Raises:
        UsageError: there is no such kind.
    """
    asked, _ = COMMAND.split(arguments)
    known = [*KINDS, CHECKPOINTS]
    for kind in asked or known:
        if kind not in known:
            raise UsageError(f"{kind}: no such kind; {hint(kind, known)}")
        if kind == CHECKPOINTS:
            print_checkpoints()
            continue
        group, typed = KINDS[kind]
        print(f"{kind}, {typed}")
        for name, path in sorted(choice_files(group).items()):
            print(printable_lines(help_row(name, description(path))))
        print()
    print_next("drivezoo new model my_net", "write one of your own")


def print_checkpoints() -> None:
    """Print the trained networks that come with drivezoo."""
    print(f"{CHECKPOINTS}, trained networks that come with drivezoo: drivezoo drive NAME sim=lake")
    for name in packaged_names():
        print(help_row(name, packaged_description(read_facts(name))))
    print()


def packaged_description(facts: Mapping[str, Any]) -> str:
    """Describe a trained network: its size, and its drives without an intervention."""
    text = f"{facts['network']}, {facts['parameters']:,} parameters"
    if drives := facts["drives"].get("lake"):
        text += f"; {drives['kept']} of {drives['drives']} laps of the lake without an intervention"
    return text


def description(path: Path) -> str:
    """Return the first sentence on a choice: of its YAML's comment, or its class's docstring."""
    text = path.read_text(encoding="utf-8")
    comment = []
    for line in text.splitlines():
        if not line.startswith("# ") or (comment and _USAGE.match(line, 2)):
            break
        if not _USAGE.match(line, 2):
            comment.append(line[2:].strip())
    found = _TARGET.search(text)
    return _sentence(" ".join(comment) or (class_docstring(found[1]) if found else ""))


def class_docstring(target: str) -> str:
    """Return the docstring of drivezoo's or a part's class, without importing it.

    Other packages' classes have none here: importing them takes seconds.
    """
    module, _, name = target.rpartition(".")
    part = part_of(target)
    file = part.file if part else None
    if file is None and (part or module.partition(".")[0] in OWN):
        spec = importlib.util.find_spec(module)
        file = Path(spec.origin) if spec and spec.origin else None
    if file is None:
        return ""
    try:
        nodes = ast.parse(file.read_text(encoding="utf-8")).body
    except (OSError, SyntaxError, ValueError):
        return ""
    classes = [one for one in nodes if isinstance(one, ast.ClassDef) and one.name == name]
    return " ".join((ast.get_docstring(classes[0]) or "").split()) if classes else ""


def printable_lines(text: str) -> str:
    """Return lines with the control characters of each escaped."""
    return "\n".join(map(printable, text.splitlines()))


def _sentence(text: str) -> str:
    return re.split(r"(?<=\.) ", text, maxsplit=1)[0].rstrip(".")


if __name__ == "__main__":
    sys.exit(run_command("zoo.list", print_choices, sys.argv[1:]))

"""Tests that other people published, on which `drivezoo evaluate challenge=NAME` scores.

An extra or another installed package names a test by the entry point `drivezoo.challenges`: a
command of two arguments, a checkpoint and the test's folder, with keys of its own.
"""

from typing import Any

from zoo.base.command import Command
from zoo.base.console_script import load
from zoo.base.entry_points import installed_entries
from zoo.base.errors import UsageError

GROUP = "drivezoo.challenges"


def challenges() -> dict[str, str]:
    """Return the place of each test's command by the test's name; nothing is imported."""
    return {entry.name: entry.value for entry in installed_entries(GROUP)}


def challenge_command(name: str) -> Command[Any]:
    """Return the command that scores on a published test.

    Raises:
        UsageError: there is no such test.
        InputError: a package's command cannot be imported.
    """
    places = challenges()
    if name not in places:
        near = f"try {', '.join(places)}" if places else "none is installed"
        raise UsageError(f"challenge={name}: no such test; {near}")
    return load(places[name])

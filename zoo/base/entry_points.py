"""What extras and other installed packages add to drivezoo: their entry points."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

ROOT = Path(__file__).parents[2]
EXTRAS = "zoo.extras."


def installed_entries(group: str) -> list[EntryPoint]:
    """Return a group's entry points of installed packages, without those of deleted extras."""
    from importlib.metadata import distributions  # slow import

    # Python also reads the packages' files in the current folder, which may be a downloaded one.
    # They must not hide an installed package's either: a script starts beside its own project.
    folders = [folder for folder in sys.path if Path(folder).resolve() != Path.cwd()]
    entries = {
        (entry.name, entry.value): entry
        for package in distributions(path=folders)
        for entry in package.entry_points
        if entry.group == group and (not is_extra(entry) or file_of(entry.value).is_file())
    }
    return list(entries.values())


def is_extra(entry: EntryPoint) -> bool:
    """Return whether an entry point names an extra of drivezoo."""
    return entry.value.startswith(EXTRAS)


def file_of(place: str) -> Path:
    """Return the file of drivezoo's module at `module` or `module:name`."""
    return ROOT.joinpath(*place.partition(":")[0].split(".")).with_suffix(".py")

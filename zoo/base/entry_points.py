"""What extras and other installed packages add to drivezoo: their entry points."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from zoo.base.errors import InputError

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

ROOT = Path(__file__).parents[2]
EXTRAS = "zoo.extras."


def installed_entries(group: str) -> list[EntryPoint]:
    """Return a group's entry points of installed packages, without those of deleted extras."""
    from importlib.metadata import entry_points  # slow import

    # Python also reads the packages' files in the current folder, which may be a downloaded one.
    here = Path.cwd()
    return [
        entry
        for entry in entry_points(group=group)
        if entry.dist and Path(str(entry.dist.locate_file(""))).resolve() != here
        if not is_extra(entry) or file_of(entry.value).is_file()
    ]


def load_entry(entry: EntryPoint, kind: str) -> Any:
    """Return what an entry point names.

    Args:
        entry: entry point of an installed package.
        kind: what it adds, for the message.

    Raises:
        InputError: it cannot be imported.
    """
    try:
        return entry.load()
    except Exception as error:  # a package's code may raise any error
        raise InputError(
            f"{entry.value}: the {kind} {entry.name} cannot be imported ({error}); install its "
            "package again"
        ) from None


def is_extra(entry: EntryPoint) -> bool:
    """Return whether an entry point names an extra of drivezoo."""
    return entry.value.startswith(EXTRAS)


def file_of(place: str) -> Path:
    """Return the file of drivezoo's module at `module` or `module:name`."""
    return ROOT.joinpath(*place.partition(":")[0].split(".")).with_suffix(".py")

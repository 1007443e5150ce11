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


def load_entry(entry: EntryPoint) -> Any:
    """Return what an entry point names.

    Raises:
        InputError: it cannot be imported.
    """
    try:
        return entry.load()
    except Exception as error:
        raise InputError(
            f"{entry.value}: the {_kind(entry.group)} {entry.name} cannot be imported ({error}); "
            "install its package again"
        ) from None


def _kind(group: str) -> str:
    """Return the kind of a group's entries in a word.

    >>> _kind("drivezoo.formats"), _kind("drivezoo.policies")
    ('format', 'policy')
    """
    return group.removeprefix("drivezoo.").removesuffix("s").replace("ie", "y")


def is_extra(entry: EntryPoint) -> bool:
    """Return whether an entry point names an extra of drivezoo."""
    return entry.value.startswith(EXTRAS)


def file_of(place: str) -> Path:
    """Return the file of drivezoo's module at `module` or `module:name`."""
    return ROOT.joinpath(*place.partition(":")[0].split(".")).with_suffix(".py")

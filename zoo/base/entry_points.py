"""What extras and other installed packages add to drivezoo: their entry points."""

from __future__ import annotations

import functools
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from zoo.base.errors import InputError, UsageError, hint

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

ROOT = Path(__file__).parents[2]
EXTRAS = "zoo.extras."


def installed_entries(group: str) -> list[EntryPoint]:
    """Return a group's entry points of extras, then of packages; without those of deleted extras.

    Args:
        group: group of the entry points; `drivezoo.` for all.
    """
    from importlib.metadata import distributions  # slow import

    # Python also reads the packages' files in the current folder, which may be a downloaded one.
    # They must not hide an installed package's either: a script starts beside its own project.
    folders = [folder for folder in sys.path if Path(folder).resolve() != Path.cwd()]
    entries = {
        (entry.name, entry.value): entry
        for package in distributions(path=folders)
        for entry in package.entry_points
        if entry.group.startswith(group) and (not is_extra(entry) or file_of(entry.value).is_file())
    }
    return sorted(entries.values(), key=is_extra, reverse=True)


def named_entries(group: str, own: Iterable[str] = ()) -> dict[str, EntryPoint]:
    """Return a group's entry points by name; print a line for each whose name is taken.

    Args:
        group: group of the entry points.
        own: names that the core has itself.
    """
    named: dict[str, EntryPoint] = {}
    for entry in installed_entries(group):
        used = "drivezoo's" if entry.name in own else named.setdefault(entry.name, entry).value
        if used != entry.value:
            _print_unused(f"{entry.value}: the {_kind(group)} {entry.name}", used)
    return named


@functools.cache  # a line for each process
def _print_unused(what: str, used: str) -> None:
    print(f"{what} is not used: {used} has that name; rename it", file=sys.stderr)


def load_entry(entry: EntryPoint, kind: Any) -> Any:
    """Return what an entry point names.

    Args:
        entry: entry point.
        kind: class that it is derived from or an instance of, or protocol that it follows.

    Raises:
        InputError: it cannot be imported, or is of another kind.
    """
    what = f"{entry.value}: the {_kind(entry.group)} {entry.name}"
    try:
        loaded = entry.load()
    except (Exception, SystemExit) as error:
        fault = f"cannot be imported ({type(error).__name__}: {error})"
        raise InputError(f"{what} {fault}; install its package again") from None
    if isinstance(loaded, kind) or kind in getattr(loaded, "__mro__", ()):
        return loaded
    raise InputError(f"{what} is no {kind.__module__}.{kind.__name__}; correct its package")


def load_entries(group: str, kind: Any) -> Iterator[Any]:
    """Yield what a group's entry points name; see `load_entry`."""
    return (load_entry(entry, kind) for entry in installed_entries(group))


def usable(entries: Iterable[EntryPoint], kind: Any) -> Iterator[tuple[str, Any]]:
    """Yield names of entry points and what they name; print a line for each broken one instead."""
    for entry in entries:
        try:
            yield entry.name, load_entry(entry, kind)
        except InputError as error:
            print(error, file=sys.stderr)


def load_named(group: str, name: str, kind: Any, key: str = "", usual: Sequence[str] = ()) -> Any:
    """Return what a group's entry point names.

    Args:
        group: group of the entry point.
        name: name of the entry point, as the user typed it.
        kind: see `load_entry`.
        key: key before the name, such as `executor=`, for messages.
        usual: names that the core has itself, for messages.

    Raises:
        UsageError: there is no such entry point.
        InputError: see `load_entry`.
    """
    return load_entry(find_entry(group, name, key, usual), kind)


def find_entry(group: str, name: str, key: str = "", usual: Sequence[str] = ()) -> EntryPoint:
    """Return a group's entry point; the arguments are those of `load_named`.

    Raises:
        UsageError: there is no such entry point.
    """
    entries = named_entries(group)
    if name not in entries:
        raise UsageError(f"{key}{name}: no such {_kind(group)}; {hint(name, [*usual, *entries])}")
    return entries[name]


def _kind(group: str) -> str:
    """Return the kind of a group's entries in a word.

    >>> _kind("drivezoo.formats"), _kind("drivezoo.policies")
    ('format', 'policy')
    """
    return group.removeprefix("drivezoo.").removesuffix("s").replace("ie", "y")


def is_extra(entry: EntryPoint) -> bool:
    """Return whether an entry point names an extra of drivezoo."""
    return entry.value.startswith(EXTRAS)


def file_of(target: str) -> Path:
    """Return the file of drivezoo's module at `module` or `module:name`."""
    return ROOT.joinpath(*target.partition(":")[0].split(".")).with_suffix(".py")

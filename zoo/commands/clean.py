"""`drivezoo clean`: list what drivezoo wrote in a folder, or remove it."""

import os
import re
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import Field

from zoo.base.command import command
from zoo.base.errors import InputError, UsageError, hint
from zoo.base.new_folder import RECORDINGS, hold_folder, is_held, is_locked, is_unfinished
from zoo.base.terminal import command_line, print_next, printable
from zoo.base.written_files import (
    LOCK,
    MARK,
    OUTPUTS,
    is_unchanged,
    marked_folder,
    read_register,
    remove_files,
    written_below,
)

CACHE, FILES, UNFINISHED = "cache", "files", "unfinished"
OUTPUTS_FOLDER = "outputs"
RECORDING_LOG = "driving_log.csv"
DAY_S = 86_400
SHOWN = 5  # names of a line
_DATE = re.compile(r"\d{4}-\d\d-\d\d")


@dataclass(frozen=True)
class Item:
    """Files that can be removed on their own.

    Attributes:
        kind: what it is, such as `cache` or `runs`.
        path: folder, or the file itself.
        files: files that drivezoo wrote.
        others: files in the folder that it did not write, which stay.
        in_use: whether a command is writing there.
    """

    kind: str
    path: Path
    files: list[Path]
    others: list[Path]
    in_use: bool

    @property
    def size(self) -> int:
        """Return the size of the files, bytes."""
        return sum(one.lstat().st_size for one in self.files if os.path.lexists(one))

    @property
    def changed(self) -> float:
        """Return the time of the newest change of the files, s since 1970."""
        return max((one.lstat().st_mtime for one in self.files if os.path.lexists(one)), default=0)


@command
def clean(
    folder: str = OUTPUTS_FOLDER,
    *,
    what: str = CACHE,
    older_days: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0,
    remove: bool = False,
) -> None:
    """List what drivezoo wrote in a folder, or remove it.

    Prints each kind with its size: the cache of decoded images, runs, sweeps, drives, and so on.
    With remove=true it removes the chosen kinds. It knows its folders by the marks that commands
    leave, not by names. Files that drivezoo did not write stay, as does what a command is writing.
    A recording is removed only if it is named: what=outputs/recordings/lake.

    Args:
        folder: folder of runs; outputs without it.
        what: kinds that the table names or folders, separated by commas; all: but recordings.
        older_days: only what nobody changed for this number of days.
        remove: true: remove it; false: only list it.

    Raises:
        InputError: the folder does not exist, or a file cannot be removed.
        UsageError: `what` names a kind that is not there.
    """
    place = Path(folder).expanduser()
    if not place.is_dir():
        kinds = f"; kinds are chosen with what={place}" if str(place) in (CACHE, "all") else ""
        raise InputError(f"{place}: no such folder; name the folder of the runs{kinds}")
    items = sorted(find_items(place), key=lambda item: (item.kind, item.path))
    kinds = sorted({item.kind for item in items})
    chosen = choose(items, kinds, what, older_days)
    from rich.console import Console
    from rich.table import Table

    table = Table("what", *("number", "size, MB", "chosen, MB", "in use"))
    for kind in kinds:
        row = [one for one in items if one.kind == kind]
        part = [one for one in row if one in chosen]
        figures = (len(row), _megabytes(row), _megabytes(part), sum(one.in_use for one in row))
        table.add_row(kind, *map(str, figures))
    Console(emoji=False).print(table)
    for line in _lines(place, items):
        print(printable(line))
    total = f"{len(chosen)} of {len(items)} items, {_megabytes(chosen)} MB"
    if remove:
        removed = [one for one in chosen if remove_item(one)]
        print(f"removed {len(removed)} of {len(items)} items, {total.rpartition(', ')[2]}")
        return
    print(f"chosen: {total}; nothing was removed")
    if chosen:
        words = ["drivezoo", "clean", folder, f"what={what}", f"older_days={older_days:g}"]
        print_next(command_line([*words, "remove=true"]), "remove what is chosen")


def choose(items: list[Item], kinds: list[str], what: str, older_days: float) -> list[Item]:
    """Return the items of the chosen kinds or paths that are old enough and not in use.

    Raises:
        UsageError: `what` names neither a kind nor an item, or all recordings at once.
    """
    wanted = {one.strip() for one in what.split(",")}
    if RECORDINGS in wanted:
        raise UsageError(
            f"what={RECORDINGS}: a recording is removed only by its name: what=FOLDER; the list "
            "without what= names all"
        )
    paths = {one.path for one in items if any(_is_named(one.path, name) for name in wanted)}
    for name in sorted(wanted - {CACHE, UNFINISHED, "all", *kinds}):
        if not any(_is_named(one, name) for one in paths):
            raise UsageError(f"what={name}: {hint(name, [*kinds, 'all'], 'the table names all')}")
    before = time.time() - older_days * DAY_S
    return [
        one
        for one in items
        if (one.path in paths or (one.kind != RECORDINGS and wanted & {one.kind, "all"}))
        and one.changed <= before
        and not one.in_use
    ]


def find_items(folder: Path) -> Iterator[Item]:
    """Yield what drivezoo marked below a folder; links are not followed."""
    for place, folders, names in os.walk(folder.absolute()):
        here = Path(place)
        kind = read_register(here / MARK).kind if MARK in names else None
        if kind is not None:
            folders.clear()
            yield from _cached(here) if kind == CACHE else _marked(here, kind)
        elif OUTPUTS in names:
            yield from (Item(FILES, one, [one], [], False) for one in _outputs(here))


def _outputs(folder: Path) -> list[Path]:
    """Return the files that users named, and that are as drivezoo wrote them."""
    known = read_register(folder / OUTPUTS).files.items()
    return [folder / name for name, sha256 in known if is_unchanged(folder / name, sha256)]


def _cached(folder: Path) -> Iterator[Item]:
    """Yield each view of a cache with the files that belong to it."""
    by_view: dict[str, list[Path]] = {}
    for one in written_below(folder)[0]:
        if one.name not in (MARK, LOCK):
            by_view.setdefault(one.name.lstrip(".").partition(".")[0], []).append(one)
    for view, files in by_view.items():
        yield Item(CACHE, folder / f"{view}.npy", files, [], is_locked(folder / f"{view}.lock"))


def _marked(folder: Path, kind: str) -> Iterator[Item]:
    """Yield a marked folder, and on their own the recordings and unfinished folders within it."""
    written, others = written_below(folder)
    places = {folder: kind}
    places |= {path.parent: RECORDINGS for path in written if path.name == RECORDING_LOG}
    places |= {path.parent: UNFINISHED for path in written if is_unfinished(path.parent)}
    items = {
        place: Item(its_kind, place, [], [], _is_in_use(folder, written))
        for place, its_kind in places.items()
    }
    for paths, is_own in ((written, True), (others, False)):
        for path in paths:
            item = items[next(place for place in path.parents if place in places)]
            # Only the killed command wrote into an unfinished folder.
            (item.files if is_own or item.kind == UNFINISHED else item.others).append(path)
    yield from items.values()


def _is_in_use(folder: Path, written: list[Path]) -> bool:
    """Return whether a command writes in a marked folder, or in one within it."""
    from zoo.runs.status import NAME, is_alive

    held = any(is_held(one.parent) for one in written if one.name == LOCK)
    return held or any(is_alive(one.parent) for one in written if one.name == NAME)


def remove_item(item: Item) -> bool:
    """Remove the files of an item, and its folders that are then empty; return False if in use.

    Raises:
        InputError: a file cannot be removed.
    """
    place = item.path if item.path.is_dir() else item.path.parent
    lock = [one for one in item.files if one.name == LOCK and one.parent == place]
    try:
        with ExitStack() as held:
            if lock:  # no command begins there from now on
                try:
                    held.enter_context(hold_folder(place))
                except InputError:
                    return False
            remove_files([one for one in item.files if one not in lock], place)
        remove_files(lock, place)
        if item.kind == FILES and not _outputs(place):
            (place / OUTPUTS).unlink(missing_ok=True)
        if _DATE.fullmatch(place.parent.name) and not any(place.parent.iterdir()):
            place.parent.rmdir()
    except OSError as error:
        raise InputError(
            f"{error.filename or item.path}: cannot be removed ({error.strerror}); what comes "
            "before it is removed"
        ) from None
    return True


def _lines(folder: Path, items: list[Item]) -> Iterator[str]:
    """Yield what is in use, what drivezoo did not write, and the names of recordings."""
    recordings = [one.path for one in items if one.kind == RECORDINGS]
    others = [path for one in items for path in one.others]
    marked = [place for one in items for place in (one.path, *one.path.parents)]
    inside = sorted(folder.absolute().iterdir()) if marked_folder(folder / MARK) is None else []
    unmarked = [one for one in inside if one not in marked and one.is_dir()]
    for text, paths in (
        ("in use, stays: {}", [one.path for one in items if one.in_use]),
        ("not written by drivezoo, stays: {}", others),
        ("without a mark of drivezoo, stays: {}", unmarked),
        ("recordings, removed only with what=FOLDER: {}", recordings),
    ):
        if paths:
            more = f" and {len(paths) - SHOWN:,} more" if len(paths) > SHOWN else ""
            yield text.format(", ".join(map(str, paths[:SHOWN]))) + more


def _is_named(path: Path, name: str) -> bool:
    return Path(os.path.normpath(Path(name).expanduser().absolute())) == path


def _megabytes(items: list[Item]) -> str:
    return f"{sum(one.size for one in items) / 1e6:,.0f}"


if __name__ == "__main__":
    clean.run()

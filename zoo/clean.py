"""`drivezoo clean [FOLDER] [key=value ...]`: list what runs left in a folder, or remove it.

Prints each kind with its size: the cache of decoded images, runs, sweeps, drives, and so on. With
remove=true it removes the chosen kinds, but never a run that is training, and never what drivezoo
did not write.
"""

import math
import re
import shlex
import shutil
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from datamodules.errors import InputError, UsageError
from zoo.cli.closing_lines import print_next
from zoo.cli.command import Command
from zoo.cli.nearest import hint
from zoo.cli.run_command import run_command

COMMAND = Command(__doc__, {"[FOLDER]": "folder of runs; outputs without it"})
CACHE, RUNS, RECORDINGS = "cache", "runs", "recordings"
DAY_S = 86_400
_DATE = re.compile(r"\d{4}-\d\d-\d\d")
_TIME = re.compile(r"\d\d-\d\d-\d\d.*")
_CACHE_FILE = re.compile(r"[0-9a-f]{24}\.(npy|json|lock)")


@dataclass(frozen=True, kw_only=True)
class CleanOptions:
    """Options of the cleaning; `conf/clean.yaml` has their meanings and defaults."""

    what: str
    older_days: float
    remove: bool

    def __post_init__(self) -> None:
        if not 0 <= self.older_days < math.inf:
            raise UsageError(f"older_days={self.older_days:g}: must be 0 or more")


@dataclass(frozen=True)
class Item:
    """A file or a folder that can be removed on its own.

    Attributes:
        kind: what it is, such as `cache` or `runs`.
        path: place of the file or folder.
        size: size of all its files, bytes.
        changed: time of the newest change of its files, s since 1970.
        in_use: whether a process trains there.
    """

    kind: str
    path: Path
    size: int
    changed: float
    in_use: bool


def clean(arguments: list[str]) -> None:
    """Print the kinds with their sizes; with `remove=true` remove the chosen ones.

    Raises:
        InputError: the folder does not exist, or a file cannot be removed.
        UsageError: `what` names a kind that is not there.
    """
    paths, options = COMMAND.read(arguments, CleanOptions)
    if len(paths) > 1:
        raise UsageError(f"{paths[1]}: name one folder; usage: {COMMAND.usage}")
    folder = Path(paths[0] if paths else "outputs").expanduser()
    if not folder.is_dir():
        kinds = (
            f"; kinds are chosen with what={folder}" if str(folder) in (CACHE, RUNS, "all") else ""
        )
        raise InputError(f"{folder}: no such folder; name the folder of the runs{kinds}")
    items = sorted(find_items(folder), key=lambda one: (one.kind, one.path))
    kinds = sorted({one.kind for one in items})
    chosen = choose(items, kinds, options)
    from rich.console import Console
    from rich.table import Table

    console = Console(emoji=False)
    table = Table("what", *("number", "size, MB", "chosen, MB", "in use"))
    for kind in kinds:
        row = [one for one in items if one.kind == kind]
        part = [one for one in row if one in chosen]
        figures = (len(row), _megabytes(row), _megabytes(part), sum(one.in_use for one in row))
        table.add_row(kind, *map(str, figures))
    console.print(table)
    total = f"{len(chosen)} of {len(items)} items, {_megabytes(chosen)} MB"
    if options.remove:
        for one in chosen:
            remove_item(one.path)
        print(f"removed {total}")
        return
    print(f"chosen: {total}; nothing was removed")
    if chosen:
        again = shlex.join(["drivezoo", "clean", *arguments, "remove=true"])
        print_next(again, "remove what is chosen")


def choose(items: list[Item], kinds: list[str], options: CleanOptions) -> list[Item]:
    """Return the items of the chosen kinds that are old enough and not in use.

    Raises:
        UsageError: `what` names a kind that drivezoo does not know.
    """
    wanted = {one.strip() for one in options.what.split(",")}
    for name in sorted(wanted - {CACHE, "all", *kinds}):
        raise UsageError(f"what={name}: {hint(name, [*kinds, 'all'], 'the table names all')}")
    before = time.time() - options.older_days * DAY_S
    return [
        one
        for one in items
        if ("all" in wanted or one.kind in wanted) and one.changed <= before and not one.in_use
    ]


def find_items(folder: Path) -> Iterator[Item]:
    """Yield what drivezoo wrote in a folder of runs; other files and links are left alone."""
    from zoo.runs.saved_config import RECIPE

    for place in _folders(folder):
        if place.name == CACHE:
            files = [one for one in place.iterdir() if _CACHE_FILE.fullmatch(one.name)]
            yield from (_item(CACHE, one) for one in files if one.is_file())
        elif place.name == RECORDINGS:
            recorded = [one for one in _folders(place) if (one / RECIPE).is_file()]
            yield from (_item(RECORDINGS, one) for one in recorded)
        elif _DATE.fullmatch(place.name):
            yield from (_item(RUNS, one) for one in _folders(place) if _TIME.fullmatch(one.name))
        else:
            dates = [one for one in _folders(place) if _DATE.fullmatch(one.name)]
            for date in dates:
                times = [one for one in _folders(date) if _TIME.fullmatch(one.name)]
                yield from (_item(place.name, one) for one in times)


def remove_item(path: Path) -> None:
    """Remove a file or a folder, and then its folder of one day if that is empty.

    Raises:
        InputError: it cannot be removed.
    """
    try:
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)
        if _DATE.fullmatch(path.parent.name) and not any(path.parent.iterdir()):
            path.parent.rmdir()
    except OSError as error:
        raise InputError(
            f"{error.filename or path}: cannot be removed ({error.strerror}); what comes before it "
            "is removed"
        ) from None


def _folders(place: Path) -> list[Path]:
    return sorted(one for one in place.iterdir() if one.is_dir() and not one.is_symlink())


def _item(kind: str, path: Path) -> Item:
    from zoo.runs.status import NAME, is_alive

    found = [one.lstat() for one in [path, *(path.rglob("*") if path.is_dir() else [])]]
    runs = {one.parent for one in path.rglob(NAME)} if path.is_dir() else set()
    return Item(
        kind,
        path,
        size=sum(one.st_size for one in found),
        changed=max(one.st_mtime for one in found),
        in_use=any(map(is_alive, runs)),
    )


def _megabytes(items: list[Item]) -> str:
    return f"{sum(one.size for one in items) / 1e6:,.0f}"


if __name__ == "__main__":
    sys.exit(run_command("zoo.clean", clean, sys.argv[1:]))

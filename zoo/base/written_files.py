"""The files that drivezoo wrote: a register in each folder of a command, and beside other outputs.

A command marks the folder that it creates with `.drivezoo.jsonl`: a line with the folder's kind,
then a line for each file that is written there. A file that a user names (`out=`, `table=`) in a
folder without a mark is a line of `.drivezoo-files.jsonl` beside it. So `drivezoo clean` and every
command that replaces a file know what is the user's. Names are relative, so that folders can move.
"""

import errno
import json
import os
import re
import stat
from collections.abc import Collection, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from zoo.base.bounded_files import hash_file, parse_json, read_regular
from zoo.base.errors import InputError, UsageError

MARK, OUTPUTS, LOCK = ".drivezoo.jsonl", ".drivezoo-files.jsonl", ".drivezoo.lock"
VERSION = 1
MOST_BYTES = 200_000_000  # of a register: that of a million images has half of it
_KIND = re.compile(r"[a-z]{1,30}", re.ASCII)
_FLAGS = os.O_WRONLY | os.O_APPEND | os.O_CREAT
for _name in ("O_NOFOLLOW", "O_NONBLOCK", "O_BINARY", "O_CLOEXEC"):
    _FLAGS |= getattr(os, _name, 0)


@dataclass(frozen=True)
class Register:
    """The kind of a marked folder, and what drivezoo wrote there.

    Attributes:
        kind: kind of the folder, such as `runs`; None for a register of single files.
        files: by path relative to the folder, the SHA-256 of a file that a user named, else None.
        folders: folders that a library, such as a logger, fills alone.
    """

    kind: str | None = None
    files: dict[str, str | None] = field(default_factory=dict)
    folders: set[str] = field(default_factory=set)


def mark_folder(folder: Path, kind: str) -> None:
    """Mark a folder as created by a command; raise OSError if it cannot be written."""
    if not os.path.lexists(folder / MARK):
        _append(folder / MARK, [{"drivezoo": VERSION, "kind": kind}])


def marked_folder(path: Path) -> Path | None:
    """Return the nearest marked folder that contains a path, or None."""
    return next((one for one in path.absolute().parents if os.path.lexists(one / MARK)), None)


def note_files(*paths: Path, library: bool = False) -> None:
    """Add files of one folder to the register of their marked folder, if they are in one.

    Args:
        *paths: files that are being written.
        library: whether they are folders that a library alone fills.

    Raises:
        OSError: the register cannot be written.
    """
    folder = marked_folder(paths[0]) if paths else None
    if folder is not None:
        names = [one.absolute().relative_to(folder).as_posix() for one in paths]
        _append(folder / MARK, [{"folder" if library else "file": name} for name in names])


def note_output(path: Path) -> None:
    """Add a file that a user named, with its hash, to the register of its folder."""
    folder, register = _place(path)
    name = path.absolute().relative_to(folder).as_posix()
    # On a full disk, or with another user's register, the file counts as the user's.
    with suppress(OSError):
        _append(folder / register, [{"file": name, "sha256": digest_of(path)}])


def checked_file(
    path: str | Path,
    endings: Collection[str],
    key: str = "out",
    inputs: Sequence[str | Path] = (),
    into_folder: bool = False,
) -> Path:
    """Return the path of a file that a user named; call before long work.

    Args:
        path: file that the command will write.
        endings: allowed endings of its name, such as `.csv`.
        key: key that names it, for the message.
        inputs: files that the command reads.
        into_folder: whether its folder must exist.

    Raises:
        UsageError: the name has another ending.
        InputError: there is no such folder, or see `check_output`.
    """
    path = Path(path).expanduser()
    if path.suffix not in endings:
        *others, last = endings
        allowed = f"{', '.join(others)} or {last}" if others else last
        raise UsageError(f"{key}={path}: must end in {allowed}; name such a file")
    if into_folder and not path.parent.is_dir():
        raise InputError(f"{key}={path}: there is no folder {path.parent}; name another file")
    check_output(path, key, inputs)
    return path


def check_output(path: Path, key: str = "out", inputs: Sequence[str | Path] = ()) -> None:
    """Refuse to replace a file that drivezoo did not write, or that the command reads.

    Args:
        path: file that the command will write.
        key: key that names it, for the message; empty for none.
        inputs: files that the command reads.

    Raises:
        InputError: the file exists, and drivezoo did not write it, or it was changed since.
    """
    named = f"{key}={path}" if key else str(path)
    if any(_is_same(path, Path(one)) for one in inputs):
        raise InputError(f"{named}: is an input of this command; name another file")
    if not os.path.lexists(path):
        return
    if path.is_dir():
        raise UsageError(f"{named}: is a folder; name a file")
    folder, register = _place(path)
    name = path.absolute().relative_to(folder).as_posix()
    files = read_register(folder / register).files
    noted = files.get(name)
    if noted is None or path.is_symlink() or noted != digest_of(path):
        reason = "was changed after drivezoo wrote it" if noted else "drivezoo did not write it"
        reason = f"belongs to the results in {folder}" if name in files and not noted else reason
        remedy = "name another file, or move this one away" if key else "move it away"
        raise InputError(f"{named}: exists, and {reason}; {remedy}")


def read_register(path: Path) -> Register:
    """Return a register; lines that are damaged or name a path outside its folder are left out."""
    try:
        lines = read_regular(path, MOST_BYTES).split(b"\n") if os.path.lexists(path) else []
    except OSError:
        return Register()
    found = [_parsed(line) for line in lines if line]
    kinds = [one.get("kind") for one in found if one.get("drivezoo") == VERSION]
    kind = kinds[0] if kinds else None
    files, folders = {}, set()
    for one in found:
        if _is_inside(name := one.get("file")):
            sha256 = one.get("sha256")
            files[str(name)] = sha256 if isinstance(sha256, str) else None
        if _is_inside(name := one.get("folder")):
            folders.add(str(name))
    known = kind if isinstance(kind, str) and _KIND.fullmatch(kind) else None
    return Register(known, files, folders)


def written_below(folder: Path) -> tuple[list[Path], list[Path]]:
    """Return the files below a folder that drivezoo wrote, and all others; links are others.

    A file counts if a register of its folder or of one above it has it, unchanged if with a hash.
    """
    above = marked_folder(folder)
    registers = [] if above is None else [(above, read_register(above / MARK))]
    known: dict[Path, str | None] = {}
    libraries: list[Path] = []
    found: list[Path] = []
    for walked, folders, names in os.walk(folder.absolute()):
        here = Path(walked)
        found += [here / one for one in names]
        found += [here / one for one in folders if (here / one).is_symlink()]
        registers += [(here, read_register(here / one)) for one in (MARK, OUTPUTS) if one in names]
    for place, register in registers:
        known |= {place / name: sha256 for name, sha256 in register.files.items()}
        known |= {place / one: None for one in (MARK, OUTPUTS, LOCK)}
        libraries += [place / one for one in register.folders]
    written: list[Path] = []
    others: list[Path] = []
    for one in found:
        is_known = one in known or any(library in one.parents for library in libraries)
        is_own = is_known and is_unchanged(one, known.get(one))
        (written if is_own else others).append(one)
    return written, others


def remove_written(folder: Path) -> None:
    """Remove what drivezoo wrote below a folder, for a command that writes it again."""
    remove_files(written_below(folder)[0], folder)


def remove_files(files: Iterable[Path], within: Path) -> None:
    """Remove files, and then their folders up to `within` that are empty; raise OSError."""
    places: set[Path] = set()
    within = within.absolute()
    for one in files:
        one.unlink(missing_ok=True)
        places |= {place for place in one.parents if place == within or within in place.parents}
    for place in sorted(places, key=lambda one: len(one.parts), reverse=True):
        if place.is_dir() and not any(place.iterdir()):
            place.rmdir()


def is_unchanged(path: Path, sha256: str | None) -> bool:
    """Return whether a file is a regular one with this hash; None stands for any."""
    try:
        found = path.lstat()
    except OSError:
        return False
    return stat.S_ISREG(found.st_mode) and sha256 in (None, digest_of(path) if sha256 else None)


def _place(path: Path) -> tuple[Path, str]:
    """Return the folder and the name of the register of a file that a user named."""
    folder = marked_folder(path)
    return (path.absolute().parent, OUTPUTS) if folder is None else (folder, MARK)


def _append(register: Path, entries: list[dict[str, object]]) -> None:
    """Append lines in one write; never through a link, and never wait for a pipe."""
    if register.is_symlink():  # Windows has no O_NOFOLLOW
        raise OSError(errno.ELOOP, f"{register.name} is a link; remove it", str(register))
    # A line begins with a line break: the last one may be written in part, by a full disk.
    text = "".join(f"\n{json.dumps(one)}" for one in entries).encode()
    descriptor = os.open(register, _FLAGS, 0o666)
    try:
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            raise OSError(errno.EINVAL, "is no regular file", str(register))
        if os.write(descriptor, text) < len(text):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(register))
    finally:
        os.close(descriptor)


def _parsed(line: bytes) -> dict:
    try:
        found = parse_json(line.decode())
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}


def _is_inside(name: object) -> bool:
    if not isinstance(name, str) or not name or "\0" in name:
        return False
    path = Path(name)
    return not path.anchor and not path.drive and ".." not in path.parts and bool(path.parts)


def _is_same(path: Path, other: Path) -> bool:
    try:
        return path.samefile(other)
    except (OSError, ValueError):
        return False


def digest_of(path: Path) -> str:
    """Return the SHA-256 of a regular file, or an empty text."""
    try:
        return hash_file(path)
    except (OSError, InputError):
        return ""

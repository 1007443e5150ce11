"""The formats of recordings, and the one door to recordings in any of them.

A format is a module with `title`, `detect` and `read` (see `Format`), and `write` if it can be
written. drivezoo's own are in `datamodules.formats`; extras and installed packages name others by
the entry point `drivezoo.formats`, users by `parts=`.
"""

import functools
import importlib
import itertools
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np

from datamodules.read_options import ReadOptions
from datamodules.recording import Recording
from datamodules.write_options import Converted, Progress, WriteOptions
from zoo.base.bounded_files import read_json
from zoo.base.entry_points import installed_entries, is_extra, load_entry
from zoo.base.errors import InputError, UsageError, hint
from zoo.base.parts import format_parts, import_part
from zoo.base.rig import UDACITY, Rig
from zoo.base.rig_file import find_rig, named_rig, write_rig

SOURCE_NAME = "source.json"  # beside the log of a converted recording
GROUP = "drivezoo.formats"  # entry points of extras and of installed packages
OWN = {
    name: f"datamodules.formats.{name}"
    for name in (
        "udacity",
        "donkeycar",
        "challenge2",
        "table",
    )
}


WITH_IMAGES = ("udacity", "table")  # formats whose images may lie in another folder


@runtime_checkable
class Format(Protocol):
    """One way to store recordings: a module, or an object, with these names.

    Attributes:
        title: the format in words, such as `Donkeycar tub`.
    """

    title: str

    def detect(self, path: Path) -> bool:
        """Return whether a folder or file has this format, by the names of its files."""

    def read(self, path: Path, options: ReadOptions) -> Recording:
        """Return the recording in a folder or file.

        Raises:
            InputError: a file is missing or damaged, or no row is left.
        """


@runtime_checkable
class WritableFormat(Format, Protocol):
    """A format that `drivezoo convert` writes, too."""

    def write(
        self, recording: Recording, out: Path, options: WriteOptions, progress: Progress
    ) -> Converted:
        """Write a recording to a new folder.

        Args:
            recording: recording to write; of several that were read as one, `names` has each.
            out: new folder, which appears when it is complete (`zoo.base.new_folder`).
            options: what the user says about the new recording.
            progress: function to call with the finished share, 0..1.

        Raises:
            InputError: an image cannot be read, `out` exists, or the disk is full.
        """


@functools.cache
def own_formats() -> dict[str, Format]:
    """Return drivezoo's formats by name: the core's, then those of extras."""
    extras = {entry.name: entry.value for entry in installed_entries(GROUP) if is_extra(entry)}
    return {name: importlib.import_module(module) for name, module in (OWN | extras).items()}


def outside_formats() -> Iterator[tuple[str, Format]]:
    """Yield the name and the format of each part of the user's and each installed package.

    Raises:
        InputError: a part or a package's format cannot be imported.
    """
    for part in format_parts():
        module = import_part(part, part.module)
        if isinstance(module, Format):
            yield part.module.rpartition(".")[2], module
    for entry in installed_entries(GROUP):
        if not is_extra(entry):
            yield entry.name, load_entry(entry)


def formats() -> dict[str, Format]:
    """Return all formats by name: drivezoo's, then those of parts and installed packages."""
    sources = dict(own_formats())
    for name, source in outside_formats():
        sources.setdefault(name, source)
    return sources


def writable_formats() -> dict[str, WritableFormat]:
    """Return the formats that can be written by name; see `formats`."""
    return {
        name: source for name, source in formats().items() if isinstance(source, WritableFormat)
    }


def known_format(path: Path, name: str | None = None) -> tuple[str, Format] | None:
    """Return the format of a folder or file and its name, None if it has none of them.

    Args:
        path: folder or file.
        name: name of the format; None finds it.

    Raises:
        InputError: it has several formats.
        UsageError: there is no format of this name.
    """
    if name is not None:
        named = formats()
        if name not in named:
            raise UsageError(f"format={name}: no such format; {hint(name, named)}")
        return name, named[name]
    fitting = [pair for pair in own_formats().items() if pair[1].detect(path)]
    # A package that cannot be imported does not matter to our own formats.
    fitting = fitting or [pair for pair in formats().items() if pair[1].detect(path)]
    if len(fitting) > 1:
        titles = ", ".join(f"{name} ({source.title})" for name, source in fitting)
        raise InputError(f"{path}: has the files of several formats, {titles}; name one: format=")
    return fitting[0] if fitting else None


def find_format(path: Path, name: str | None = None) -> tuple[str, Format]:
    """Return the format of the recording in a folder or file, and its name.

    Raises:
        InputError: there is no such folder, or it has none of the formats, or several.
        UsageError: there is no format of this name.
    """
    named = known_format(path, name)
    if named and (path.exists() or named[1].detect(path)):  # an address does not exist here
        return named
    raise InputError(importlib.import_module("datamodules.formats.path_contents").describe(path))


def check_roots(roots: str | Sequence[str] | None) -> None:
    """Raise InputError if a folder or file of a recording does not exist; nothing is read."""
    for root in [roots] if isinstance(roots, str) else roots or []:
        path = Path(root).expanduser()
        if not path.exists():
            find_format(path)


def read_recording(path: Path, options: ReadOptions) -> tuple[str, Recording]:
    """Return the format of a recording and its rows, with the car's rig of the user's file.

    Raises:
        InputError, UsageError: see `find_format` and `Format.read`; or the rig's file is wrong.
    """
    try:
        name, source = find_format(path, options.format)
        if options.images and name in own_formats() and name not in WITH_IMAGES:
            raise UsageError(
                f"images={options.images}: {path} is a {source.title}, which names its own "
                "images; leave images= out"
            )
        recording = replace(source.read(path, options), format=name)
    except OSError as error:
        raise InputError(
            f"{error.filename or path}: {error.strerror or error}; allow your user to read it, or "
            "name another folder"
        ) from None
    folder = path.parent if path.is_file() else path
    rig = named_rig(options.rig) if options.rig else find_rig(folder)
    if rig is None and read_source(recording.names):
        return name, replace(recording, rig=None)  # converted: the log's format is not the car's
    return name, replace(recording, rig=rig, rigs=()) if rig else recording


def read_recordings(roots: str | Sequence[str], **said: Any) -> Recording:
    """Read one folder, or several as one `Recording`, in any of the formats.

    Args:
        roots: folders or files of recordings.
        **said: fields of `ReadOptions`.

    Raises:
        InputError: a folder, log, row or image is missing or wrong.
        UsageError: a format or what the user says of it does not exist.
    """
    roots = [roots] if isinstance(roots, str) else list(roots)
    if not roots:
        raise InputError("data.root is an empty list: name the folder of a recording")
    options = ReadOptions(**said).of_each(len(roots))
    parts = [
        read_recording(Path(root).expanduser(), option)[1]
        for root, option in zip(roots, options, strict=True)
    ]
    if any(part.places is not None for part in parts) and len(parts) > 1:
        parts = [replace(part, places=_places(part)) for part in parts]
    joined: dict[str, Any] = {
        name: np.concatenate([part.columns[name] for part in parts]) for name in parts[0].columns
    }
    rigs = [rig for part in parts for rig in part.each_rig]
    first = itertools.accumulate((len(part.names) for part in parts[:-1]), initial=0)
    joined["recording"] += np.repeat(list(first), [len(part) for part in parts])
    whole = Recording(
        names=tuple(name for part in parts for name in part.names),
        bad_images=tuple(line for part in parts for line in part.bad_images),
        bad_rows=tuple(line for part in parts for line in part.bad_rows),
        rig=rigs[0] if rigs.count(rigs[0]) == len(rigs) else None,
        notes=tuple(f"{part.names[0]}: {note}" for part in parts for note in part.notes),
        rigs=tuple(rigs),
        blocks=max((part.blocks for part in parts), key=lambda blocks: blocks.block_s),
        format=parts[0].format,
        **joined,
    )
    if not len(whole):
        faults = whole.bad_images
        reason = f", all {len(faults)} have a bad image ({faults[0]})" if faults else ""
        folder = ", or set data.images=FOLDER" if whole.places is None else ""
        remedy = f"copy the images{folder}" if faults else "record it again"
        raise InputError(f"{', '.join(whole.names)}: no rows left{reason}; {remedy}")
    return whole


def _places(recording: Recording) -> np.ndarray:
    return np.array([recording.place(row) for row in range(len(recording))], object)


def write_car(
    folder: Path, recording: Recording, source: str = "another_car", keeps_size: bool = True
) -> None:
    """Write beside a copy of a recording that its car is not Udacity's, and the rig if it is known.

    Args:
        folder: folder of the copy, whose format may be that of Udacity's car.
        recording: recording that was copied.
        source: its format, unless it is a copy, too.
        keeps_size: whether the images have the rig's size, without which it is of another camera.
    """
    recorded = read_source(recording.names) or source
    write_rig_of(folder, recording.rig, recorded, keeps_size)


def write_rig_of(folder: Path, rig: Rig | None, source: str, keeps_size: bool = True) -> None:
    """Write the car or format of a log's frames, and the rig if it is known, if not Udacity's."""
    if rig == UDACITY:
        return
    text = f'{{"version": 1, "format": "{source}"}}\n'
    (folder / SOURCE_NAME).write_text(text, encoding="utf-8")
    if rig and keeps_size:
        write_rig(folder, rig)


def read_source(folders: Iterable[str | Path]) -> str | None:
    """Return the format that one of the recordings was converted from; None for Udacity's rig.

    Raises:
        InputError: the file that names the format is damaged.
    """
    for folder in folders:
        path = Path(folder) / SOURCE_NAME
        if path.is_file():
            content = read_json(path)
            source = content.get("format") if isinstance(content, dict) else None
            if not isinstance(source, str) or not re.fullmatch(r"[\w.-]{1,80}", source):
                raise InputError(f"{path}: format: must be the name of a format, such as lerobot")
            return source
    return None


def other_car(recording: Recording) -> str | None:
    """Return the name of the car or format of a recording; None if it is Udacity's car.

    Raises:
        InputError: see `read_source`.
    """
    if source := read_source(recording.names):
        return source
    if recording.rig == UDACITY:
        return None
    return recording.rig.name if recording.rig else "a car of unknown make"

"""The formats of recordings: drivezoo's, and those of extras, of the user's parts and of packages.

A format is a module with `title`, `detect` and `read` (see `Format`), and `write` if it can be
written. drivezoo's own are in `datamodules.formats`; extras and installed packages name others by
the entry point `drivezoo.formats`, users by `parts=`.
"""

import functools
import importlib
from collections.abc import Iterator
from pathlib import Path
from typing import Protocol, runtime_checkable

from datamodules.format_options import Converted, Progress, ReadOptions, WriteOptions
from datamodules.recording import Recording
from zoo.base.entry_points import installed_entries, is_extra, load_entry, named_entries
from zoo.base.errors import InputError, UsageError, hint
from zoo.base.parts import format_parts, import_part

GROUP = "drivezoo.formats"  # entry points of extras and of installed packages
OWN = ("udacity", "donkeycar", "challenge2", "table")


@runtime_checkable
class Format(Protocol):
    """One way to store recordings: a module, or an object, with these names.

    Attributes:
        title: the format in words, such as `Donkeycar tub`.

    A format of drivezoo names in `uses` the keys of `recording_format.NOT_FOR_ALL` that it uses;
    typed for recordings of others alone, they are refused.
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
    """A format that `drivezoo convert` writes, too.

    Its attribute `keys`, if it has one, names the fields of `WriteOptions` that it uses and others
    do not; typed for a format that does not name them, they are refused.
    """

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
    own = {name: f"datamodules.formats.{name}" for name in OWN}
    extras = {entry.name: entry.value for entry in installed_entries(GROUP) if is_extra(entry)}
    return {name: importlib.import_module(module) for name, module in (own | extras).items()}


def outside_formats() -> Iterator[tuple[str, Format]]:
    """Yield the name and the format of each installed package and each part of the user's.

    Raises:
        InputError: a part or a package's format cannot be imported, or a part's name is ours.
    """
    for entry in named_entries(GROUP, OWN).values():
        if not is_extra(entry):
            yield entry.name, load_entry(entry, Format)
    for part in format_parts():
        module, name = import_part(part, part.module), part.module.rpartition(".")[2]
        if isinstance(module, Format):
            if name in own_formats():
                raise InputError(f"{part.name}: drivezoo has a format {name}; rename your file")
            yield name, module


def formats() -> dict[str, Format]:
    """Return all formats by name: drivezoo's, then those of installed packages and of parts."""
    return own_formats() | dict(outside_formats())


def writable_formats() -> dict[str, WritableFormat]:
    """Return the formats that can be written by name; see `formats`."""
    return {name: each for name, each in formats().items() if isinstance(each, WritableFormat)}


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

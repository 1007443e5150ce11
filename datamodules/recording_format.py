"""The one door to recordings in any of the formats."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from datamodules.format_options import ReadOptions
from datamodules.known_formats import Format, known_format, own_formats
from datamodules.recorded_car import read_copy
from datamodules.recording import Recording
from datamodules.steering_unit import EXAMPLE
from zoo.base.errors import InputError, UsageError
from zoo.base.rig_file import find_rig, named_rig

ALIKE = 1.02  # radii of cars that steer alike
NOT_FOR_ALL = ("images", "columns", "steering", "camera", "speed_unit")  # see `Format.uses`


def find_format(path: Path, name: str | None = None) -> tuple[str, Format]:
    """Return the format of the recording in a folder or file, and its name.

    Raises:
        InputError: there is no such folder, or it has none of the formats, or several.
        UsageError: there is no format of this name.
    """
    named = known_format(path, name)
    if named and (path.exists() or named[1].detect(path)):  # an address does not exist here
        return named
    from datamodules.formats.path_contents import describe  # slow import

    raise InputError(describe(path))


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
        recording = replace(source.read(path, options), format=name)
    except OSError as error:
        raise InputError(
            f"{error.filename or path}: {error.strerror or error}; allow your user to read it, or "
            "name another folder"
        ) from None
    folder = path.parent if path.is_file() else path
    rig = named_rig(options.rig) if options.rig else find_rig(folder)
    original, blocks = read_copy(recording.names)
    if original:  # converted: the log's format is not the car's
        recording = replace(recording, rig=None, blocks=blocks)
    return name, replace(recording, rig=rig, rigs=()) if rig else recording


def unused_keys(name: str, options: ReadOptions) -> set[str]:
    """Return the keys that the user gave, and that a format of drivezoo does not use."""
    source = own_formats().get(name)
    uses = getattr(source, "uses", ()) if source else NOT_FOR_ALL
    is_unit = {"steering"} if options.steering_name is None else set()
    return (set(NOT_FOR_ALL) & set(options.given())) - set(uses) - is_unit


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
    each = ReadOptions(**said).of_each(len(roots))
    pairs = zip(roots, each, strict=True)
    parts = [read_recording(Path(root).expanduser(), options)[1] for root, options in pairs]
    unused = [unused_keys(part.format, options) for part, options in zip(parts, each, strict=True)]
    used = {key for at, options in enumerate(each) for key in options.given().keys() - unused[at]}
    for key in sorted(set().union(*unused) - used):
        part = next(part for part, keys in zip(parts, unused, strict=True) if key in keys)
        unit = f', or write "steering={{{EXAMPLE}}}"' if key == "steering" else ""
        raise UsageError(
            f"{key}= is not for the format {part.format} of {part.names[0]}; leave {key}= out{unit}"
        )
    if any(part.places is not None for part in parts) and len(parts) > 1:
        parts = [replace(part, places=_places(part)) for part in parts]
    joined: dict[str, Any] = {
        name: np.concatenate([part.columns[name] for part in parts]) for name in parts[0].columns
    }
    rigs = [rig for part in parts for rig in part.each_rig]
    first = np.cumsum([0, *(len(part.names) for part in parts[:-1])])
    joined["recording"] += np.repeat(first, [len(part) for part in parts])
    whole = Recording(
        names=tuple(name for part in parts for name in part.names),
        bad_images=tuple(line for part in parts for line in part.bad_images),
        bad_rows=tuple(line for part in parts for line in part.bad_rows),
        rig=rigs[0] if rigs.count(rigs[0]) == len(rigs) else None,
        notes=tuple(f"{part.names[0]}: {note}" for part in parts for note in part.notes),
        rigs=tuple(rigs),
        units=tuple(unit for part in parts for unit in part.units or [None] * len(part.names)),
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
    return replace(whole, notes=(*whole.notes, *_full_locks(whole)))


def _full_locks(recording: Recording) -> Iterator[str]:
    """Yield a note if the same steering is another bend to one of the cars."""
    rigs = zip(recording.names, recording.each_rig, strict=True)
    radii = sorted((float(1 / rig.curvature(1.0)), name) for name, rig in rigs if rig)
    if radii and radii[-1][0] > ALIKE * radii[0][0]:
        least, most = (f"{radius:.1f} m in {name}" for radius, name in (radii[0], radii[-1]))
        yield f"full lock: a radius of {least}, {most}; data.label=curvature has one unit for both"


def _places(recording: Recording) -> np.ndarray:
    return np.array([recording.place(row) for row in range(len(recording))], object)

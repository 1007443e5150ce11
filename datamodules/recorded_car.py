"""The car of a recording: written beside a copy, so that it is not taken for Udacity's car."""

import json
import re
from collections.abc import Iterable
from pathlib import Path

from datamodules.recording import LONG_DRIVE, SHORT_DRIVES, Blocks, Recording
from zoo.base.errors import InputError
from zoo.base.plain_files import read_json
from zoo.base.rig import UDACITY, Rig
from zoo.base.rig_file import write_rig

SOURCE_NAME = "source.json"  # beside the log of a converted recording
AND, UDACITYS = " and ", "Udacity's simulator"  # in the names of several cars


def write_car(folder: Path, recording: Recording, source: str = "another_car") -> None:
    """Write beside a copy that its car is not Udacity's, the rig if it is known, and long drives.

    Args:
        folder: folder of the copy, whose format may be that of Udacity's car.
        recording: recording that was copied.
        source: its format, unless it is a copy, too.
    """
    source = read_source(recording.names) or source
    write_rig_of(folder, recording.rig, source, is_long=recording.blocks == LONG_DRIVE)


def write_rig_of(folder: Path, rig: Rig | None, source: str, is_long: bool = False) -> None:
    """Write the car or format of a log's frames, and the rig if it is known, if not Udacity's."""
    if rig == UDACITY:
        return
    name = re.sub(r"[^\w.-]", "_", source[:80])  # of a road's file, it may have blanks
    content = {"version": 1, "format": name, "long_drive": is_long}
    (folder / SOURCE_NAME).write_text(f"{json.dumps(content)}\n", encoding="utf-8")
    if rig:
        write_rig(folder, rig)


def read_source(folders: Iterable[str | Path]) -> str | None:
    """Return the format that one of the recordings was converted from; None for Udacity's rig."""
    return read_copy(folders)[0]


def read_copy(folders: Iterable[str | Path]) -> tuple[str | None, Blocks]:
    """Return the format that one of the recordings was converted from, and the original's blocks.

    Raises:
        InputError: the file that names the format is damaged.
    """
    for folder in folders:
        path = Path(folder) / SOURCE_NAME
        if path.is_file():
            contents = read_json(path)
            about = contents if isinstance(contents, dict) else {}
            source = about.get("format")
            if not isinstance(source, str) or not re.fullmatch(r"[\w.-]{1,80}", source):
                raise InputError(f"{path}: format: must be the name of a format, such as lerobot")
            return source, LONG_DRIVE if about.get("long_drive") else SHORT_DRIVES
    return None, SHORT_DRIVES


def other_car(recording: Recording) -> str | None:
    """Return the name of the car or format of a recording, see `car_names`.

    Raises:
        InputError: see `read_source`.
    """
    rigs = zip(recording.names, recording.each_rig, strict=True)
    return car_names(read_source([folder]) or _car_name(rig) for folder, rig in rigs)


def _car_name(rig: Rig | None) -> str | None:
    if rig == UDACITY:
        return None
    return rig.name if rig else "a car of unknown make"


def car_names(others: Iterable[str | None]) -> str | None:
    """Return the names of several cars, where None is Udacity's; None if all are Udacity's.

    >>> car_names([None, "my car", None]), car_names([None, None])
    ("Udacity's simulator and my car", None)
    """
    cars = dict.fromkeys(others)
    return AND.join(car or UDACITYS for car in cars) if any(cars) else None

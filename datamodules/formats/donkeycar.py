"""Read a Donkeycar tub: `manifest.json` with catalogs (Donkeycar 4 and 5), or `record_*.json`.

Written after the format of `donkeycar/parts/tub_v2.py` and `datastore_v2.py` (version 5.3), and
`datastore.py` of version 3.
"""

import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from datamodules.driving_log import BadRows
from datamodules.formats.json_fields import number, parse, plain_name
from datamodules.image_files import find_file_fault
from datamodules.recording import ReadOptions, Recording, keep_valid, make_recording
from datamodules.stretches import times_of_drives
from zoo.base.bounded_files import MOST_JSON_BYTES, read_text
from zoo.base.errors import InputError
from zoo.base.limits import check_most
from zoo.base.regular_file import open_text
from zoo.base.rig import MPS_PER_MPH, UDACITY

MANIFEST = "manifest.json"  # a tub of Donkeycar 3 has a file for each record
NUMBERS = ("steering", "throttle", "brake", "speed_mph", "time_s")
STAMPS = ("_timestamp_ms", "milliseconds")
IMAGES = "images"
IMAGE, ANGLE, THROTTLE, MODE = "cam/image_array", "user/angle", "user/throttle", "user/mode"
SPEEDS_MPS = ("enc/speed", "pos/speed")  # an odometer's, a simulator's
# Keys of drivezoo's own tubs: values that Donkeycar has no key for, unchanged to the bit.
EXACT = {
    "throttle": "drivezoo/throttle",
    "brake": "drivezoo/brake",
    "speed": "drivezoo/speed_mph",
}
LOOP_HZ = 20.0  # Donkeycar's loop, for records without a time
MOST_CATALOG_BYTES = 500_000_000

_OLD_RECORD = re.compile(r"record_(\d{1,9})\.json")


title = "Donkeycar tub"


def detect(path: Path) -> bool:
    """Return whether a folder holds a manifest, or records of Donkeycar 3."""
    return (path / MANIFEST).exists() or any(True for _ in _old_paths(path))


def read(path: Path, options: ReadOptions) -> Recording:
    """Return a tub's records.

    Records that the tub marks as deleted, that an autopilot drove, or whose image is damaged are
    left out. The angle becomes the steering. A throttle below 0 stays; the brake is 0.

    Raises:
        InputError: a file is missing or damaged, a value is wrong, or nothing is left.
    """
    bad, bad_images, records = BadRows(options.on_bad_row), [], []
    deleted = piloted = 0
    texts = _new_records(path) if (path / MANIFEST).exists() else _old_records(path)
    for count, (place, text, images) in enumerate(texts, 1):
        check_most("rows", count, path, "divide the tub")
        if text is None:
            deleted += 1
            continue
        try:
            record = _record(place, text, images)
        except InputError as error:
            bad.faults.append(str(error).rpartition("; ")[0])  # `finish` has the remedy
            continue
        if record is None:
            piloted += 1
        elif fault := find_file_fault(record["image"]):
            bad_images.append(f"{place}: {fault}")
        else:
            records.append(record)
    if not records and not bad.faults:
        reason = bad_images[0] if bad_images else "all are deleted or driven by an autopilot"
        raise InputError(f"{path}: no record is left: {reason}; name another tub")
    columns = {name: [record[name] for record in records] for name in (records or [{}])[0]}
    numbers = {name: np.array(columns.get(name, ()), float) for name in NUMBERS}
    if np.isnan(numbers["time_s"]).any():
        sessions = {one: index for index, one in enumerate(dict.fromkeys(columns["session"]))}
        drive = np.array([sessions[one] for one in columns["session"]])
        numbers["time_s"] = times_of_drives(drive, np.arange(len(drive)) / LOOP_HZ)
    notes = []
    if deleted:
        notes.append(f"{deleted:,} records left out that the tub marks as deleted")
    if piloted:
        notes.append(f"{piloted:,} records left out that an autopilot drove")
    if not any(columns.get("has_speed", ())):
        notes.append("the tub has no speed: the log has 0 mph in each row")
    recording = make_recording(
        path,
        numbers,
        {"center": columns.get("image", [])},
        places=np.array(columns.get("place", ()), object),
        bad_images=tuple(bad_images),
        notes=tuple(notes),
        # Of drivezoo's own tubs; the rig of others is unknown.
        rig=UDACITY if any(columns.get("is_own", ())) else None,
    )
    return keep_valid(recording, bad)


def _record(place: str, text: str, images: str) -> dict[str, Any] | None:
    """Return a record's values; None if an autopilot drove."""
    found = parse(text, place, dict)
    if found.get(MODE, "user") != "user":
        return None
    speed_key = next((key for key in SPEEDS_MPS if key in found), SPEEDS_MPS[0])
    speed_mph = abs(number(found, speed_key, place, 0.0)) / MPS_PER_MPH
    stamp = next((key for key in STAMPS if key in found), None)
    return {
        "place": place,
        "image": images + plain_name(found.get(IMAGE), place, IMAGE),
        "steering": number(found, ANGLE, place),
        "throttle": number(found, EXACT["throttle"], place, number(found, THROTTLE, place, 0.0)),
        "brake": number(found, EXACT["brake"], place, 0.0),
        "speed_mph": number(found, EXACT["speed"], place, speed_mph),
        "time_s": number(found, stamp, place) / 1000 if stamp else np.nan,
        "session": str(found.get("_session_id", "")),
        "has_speed": any(key in found for key in (*SPEEDS_MPS, EXACT["speed"])),
        "is_own": EXACT["speed"] in found,
    }


def _new_records(folder: Path) -> Iterator[tuple[str, str | None, str]]:
    """Yield each record's place, text (None if it is deleted), and folder of images."""
    path = folder / MANIFEST
    lines = read_text(path, MOST_JSON_BYTES).splitlines()
    if len(lines) < 5:
        raise InputError(
            f"{path}, row {len(lines)}: the manifest has {len(lines)} of 5 rows; copy the tub again"
        )
    place = f"{path}, row 5"
    catalogs = parse(lines[4], place, dict)
    deleted = catalogs.get("deleted_indexes", [])
    paths = catalogs.get("paths")
    if not isinstance(deleted, list) or not isinstance(paths, list):
        raise InputError(f"{place}: no lists paths and deleted_indexes; copy the tub again")
    names = [plain_name(name, place, "a catalog") for name in paths]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(f"{place}: names the catalog {twice} more than once; name it once")
    gone = {one for one in deleted if isinstance(one, int)}
    images = f"{folder / IMAGES}{os.sep}"
    index = 0
    for name in names:
        catalog = folder / name
        # Bytes that are not UTF-8 make one record bad, not the catalog.
        with open_text(catalog, MOST_CATALOG_BYTES, errors="surrogateescape") as file:
            for line, text in enumerate(file, 1):
                if not text.strip():
                    continue
                # As Donkeycar does: a deleted index counts the records, whatever their _index.
                yield f"{catalog}, row {line}", None if index in gone else text, images
                index += 1


def _old_records(folder: Path) -> Iterator[tuple[str, str, str]]:
    images = f"{folder}{os.sep}"
    for _, path in sorted(_old_paths(folder)):
        with open_text(path, MOST_JSON_BYTES, errors="surrogateescape") as file:
            yield str(path), file.read(), images


def _old_paths(folder: Path) -> Iterator[tuple[int, Path]]:
    """Yield the number and path of each record of Donkeycar 3, in no order."""
    named = ((_OLD_RECORD.fullmatch(path.name), path) for path in folder.glob("record_*.json"))
    return ((int(match[1]), path) for match, path in named if match)

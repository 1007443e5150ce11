"""The format of Donkeycar's tubs: `manifest.json` with catalogs (4 and 5), or `record_*.json`.

Written after the format of `donkeycar/parts/tub_v2.py` and `datastore_v2.py` (version 5.3), and
`datastore.py` of version 3.
"""

import functools
import itertools
import json
import os
import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from datamodules.driving_log import BadRows
from datamodules.format_options import Converted, Progress, ReadOptions, WriteOptions
from datamodules.formats.json_fields import number, parse, plain_name
from datamodules.formats.path_contents import SUGGESTED, find_below
from datamodules.formats.recording_writer import left_out_note, put_image, reported, whole_rows
from datamodules.image import find_file_fault
from datamodules.recorded_car import write_car
from datamodules.recording import (
    TIMED_LABELS,
    Recording,
    fold,
    keep_valid,
    list_files,
    make_recording,
    spellings,
    unnamed_note,
)
from datamodules.stretches import complete_times, continuous_drives, in_seconds, times_of_drives
from zoo.base.bounded_files import MOST_JSON_BYTES, open_text, read_text
from zoo.base.errors import InputError
from zoo.base.limits import check_most, is_ordinary
from zoo.base.new_folder import whole_folder
from zoo.base.rig import MPS_PER_MPH, UDACITY
from zoo.base.terminal import counted

MANIFEST = "manifest.json"  # a tub of Donkeycar 3 has a file for each record
STAMPS = ("_timestamp_ms", "milliseconds")
IMAGES = "images"
IMAGE, ANGLE, THROTTLE, MODE = "cam/image_array", "user/angle", "user/throttle", "user/mode"
# Forks record what the car did, without `user/`.
ANGLES, THROTTLES = (ANGLE, "steering"), (THROTTLE, "throttle")
SPEEDS_MPS = ("enc/speed", "pos/speed")  # an odometer's, a simulator's
# Keys of drivezoo's own tubs: values that Donkeycar has no key for, unchanged to the bit.
EXACT = {name: f"drivezoo/{name}" for name in ("throttle", "brake", "speed_mph")}
LOOP_HZ = 20.0  # Donkeycar's loop, for records without a time
MOST_CATALOG_BYTES = 500_000_000

CATALOGS = "[!.]*.catalog"

_OLD_RECORD = re.compile(r"record_(\d{1,9})\.json")


title = "Donkeycar tub"
CATALOG_ROWS = 1000  # records in a catalog, as Donkeycar writes them
TYPES = {
    IMAGE: "image_array",
    ANGLE: "float",
    THROTTLE: "float",
    MODE: "str",
    SPEEDS_MPS[0]: "float",
    **{key: "float" for key in EXACT.values()},
}


def detect(path: Path) -> bool:
    """Return whether a folder holds a manifest or a catalog, or records of Donkeycar 3."""
    return any(itertools.chain(path.glob(MANIFEST), path.glob(CATALOGS), _old_paths(path)))


def read(path: Path, options: ReadOptions) -> Recording:
    """Return a tub's records.

    Records that the tub marks as deleted, or that an autopilot drove, are left out. The angle
    becomes the steering. A throttle below 0 stays; the brake is 0.

    Raises:
        InputError: a file is missing or damaged, a value is wrong, or nothing is left.
    """
    bad, bad_images = BadRows(options.on_bad_row), []
    columns: dict[str, list] = {}
    deleted = piloted = 0
    is_old, count = next(path.glob(CATALOGS), None) is None and not (path / MANIFEST).exists(), 0
    texts = _old_records(path) if is_old else _new_records(path, bad.notes)
    spelled = functools.cache(lambda folder: spellings(list_files(folder)))
    for count, (index, source, text, images) in enumerate(texts, 1):
        check_most("rows", count, path, "divide the tub")
        if text is None:
            deleted += 1
            continue
        try:
            record = _record(source, text, images)
        except InputError as error:
            bad.faults.append(str(error).rpartition("; ")[0])  # `finish` has the remedy
            continue
        if record is None:
            piloted += 1
            continue
        fault, name = find_file_fault(record["image"]), record["image"].removeprefix(images)
        if fault and (other := spelled(images).get(fold(name))):  # its case may differ
            record["image"], fault = other, find_file_fault(other)
        if fault:
            bad_images.append(f"{source}: {fault}")
        else:
            for name, value in (record | {"line": index}).items():
                columns.setdefault(name, []).append(value)
    options.check_images(bad_images, len(bad_images) + len(columns.get("line", [])))
    if not columns:
        bad.finish(0)
        causes = {"deleted": deleted, "driven by an autopilot": piloted}
        left_out = ", ".join(f"{count:,} {cause}" for cause, count in causes.items() if count)
        what = f"no record is left: {left_out}" if left_out else "the tub has no records"
        others = " or ".join(map(str, find_below(path)[:SUGGESTED]))
        remedy = f"name {others}" if others else "record a drive by hand"
        raise InputError(f"{path}: {what}; {remedy}")
    columns["time_s"] = in_seconds(columns["time_s"], most=1e3)
    numbers = {name: np.array(columns[name], float) for name in TIMED_LABELS}
    if options.unit:
        numbers["steering"] = options.unit.steering(numbers["steering"])
    untimed = int(np.isnan(numbers["time_s"]).sum())
    session = np.unique(columns["session"], return_inverse=True)[1]
    line = np.array(columns["line"]) + np.cumsum(np.diff(session, prepend=session[0]) != 0)
    if untimed:
        numbers["time_s"] = times_of_drives(session, line / LOOP_HZ)
    counts = {
        f"{counted(deleted, 'record')} left out that the tub marks as deleted": deleted,
        f"{counted(piloted, 'record')} left out that an autopilot drove": piloted,
        f"{counted(untimed, 'record')} without a time: {LOOP_HZ:g} a second are assumed": untimed,
        "the tub has no speed: the log has 0 mph in each row": not any(columns["has_speed"]),
    }
    recording = make_recording(
        path,
        numbers,
        {"center": columns["image"]},
        places=np.array(columns["place"], object),
        line=line,
        bad_images=tuple(bad_images),
        notes=tuple(note for note, number in counts.items() if number),
        # Of drivezoo's own tubs; the rig of others is unknown.
        rig=UDACITY if any(columns["is_own"]) else None,
    )
    folder = str(path if is_old else path / IMAGES)
    bad.notes += unnamed_note([folder], recording.images, count - len(recording))
    return keep_valid(recording, bad)


def _record(source: str, text: str, images: str) -> dict[str, Any] | None:
    """Return a record's values; None if an autopilot drove."""
    entry = parse(text, source, dict)
    if entry.get(MODE, "user") != "user":
        return None
    angle, throttle, speed, stamp = (
        next((key for key in keys if key in entry), keys[0])
        for keys in (ANGLES, THROTTLES, SPEEDS_MPS, STAMPS)
    )
    speed_mph = abs(number(entry, speed, source, 0.0)) / MPS_PER_MPH
    return {
        "place": source,
        "image": images + plain_name(entry.get(IMAGE), source, IMAGE),
        "steering": number(entry, angle, source),
        "throttle": number(entry, EXACT["throttle"], source, number(entry, throttle, source, 0.0)),
        "brake": number(entry, EXACT["brake"], source, 0.0),
        "speed_mph": number(entry, EXACT["speed_mph"], source, speed_mph),
        "time_s": number(entry, stamp, source) if stamp in entry else np.nan,
        "session": str(entry.get("_session_id", "")),
        "has_speed": speed in entry or EXACT["speed_mph"] in entry,
        "is_own": EXACT["speed_mph"] in entry,
    }


def _new_records(folder: Path, notes: list[str]) -> Iterator[tuple[int, str, str | None, str]]:
    """Yield each record's number, place, text (None if it is deleted), and folder of images.

    Args:
        folder: folder of the tub.
        notes: list to which a line is added on what the manifest and the catalogs do not agree in.
    """
    path, source = folder / MANIFEST, f"{folder / MANIFEST}, row 5"
    there = [catalog.name for catalog in sorted(sorted(folder.glob(CATALOGS)), key=_natural)]
    if path.exists():
        lines = read_text(path, MOST_JSON_BYTES).splitlines()
        manifest = parse(lines[4] if len(lines) > 4 else "", source, dict)
        gone, counted = _deleted(manifest, source), manifest.get("current_index")
        names = [plain_name(name, source, "a catalog") for name in manifest["paths"]]
        if len(set(names)) < len(names):
            raise InputError(f"{source}: names a catalog more than once; name each once")
        others = ", ".join(name for name in there if name not in names)
        notes += [f"{others}: left out, since {MANIFEST} does not name it"] if others else []
    else:
        gone, counted, names = set(), None, there
        notes.append(f"no {MANIFEST}: deleted records are read, too, of {', '.join(names)}")
    images, index = f"{folder / IMAGES}{os.sep}", 0
    for name in names:
        catalog = folder / name
        if not os.path.exists(catalog):  # noqa: PTH110 - False for a name that is too long
            raise InputError(
                f"{source}: the catalog {name:.80} is missing; copy it there, or delete its name"
            )
        # Bytes that are not UTF-8 make one record bad, not the catalog.
        with open_text(catalog, MOST_CATALOG_BYTES, errors="surrogateescape") as file:
            for line, text in enumerate(file, 1):
                half_written = name == names[-1] and text[-1] != "\n" and text[-1] != "}"
                if not text.strip() or half_written:
                    continue
                # As Donkeycar does: a deleted index counts the records, whatever their _index.
                yield index, f"{catalog}, row {line}", None if index in gone else text, images
                index += 1
    if is_ordinary(counted) and counted != index:
        notes.append(f"{MANIFEST} counts {counted:,} records, and its catalogs hold {index:,}")


def _deleted(manifest: dict[str, Any], source: str) -> set[int]:
    """Return the numbers of deleted records, which programs also write as texts."""
    deleted, paths = manifest.get("deleted_indexes", []), manifest.get("paths")
    if isinstance(deleted, str):
        deleted = [part for part in re.split(r"[\s,\[\]]+", deleted) if part]
    if not isinstance(deleted, list) or not isinstance(paths, list):
        raise InputError(f"{source}: no lists paths and deleted_indexes; copy the tub again")
    for index in deleted:
        if not re.fullmatch(r"\d{1,9}(\.0)?", str(index)):
            raise InputError(
                f"{source}: deleted_indexes has {index!r:.40}, no number of a record; correct it"
            )
    return {int(float(index)) for index in deleted}


def _natural(path: Path) -> list[tuple[int, str]]:
    """Return a key that sorts `catalog_10` behind `catalog_9`."""
    return [(int(digits or 0), text) for text, digits in re.findall(r"(\D*)(\d{0,9})", path.name)]


def _old_records(folder: Path) -> Iterator[tuple[int, str, str, str]]:
    for index, path in sorted(_old_paths(folder)):
        with open_text(path, MOST_JSON_BYTES, errors="surrogateescape") as file:
            yield index, str(path), file.read(), f"{folder}{os.sep}"


def _old_paths(folder: Path) -> Iterator[tuple[int, Path]]:
    """Yield the number and path of each record of Donkeycar 3, in no order."""
    for path in folder.glob("record_*.json"):
        if match := _OLD_RECORD.fullmatch(path.name):
            yield int(match[1]), path


def write(recording: Recording, out: Path, options: WriteOptions, progress: Progress) -> Converted:
    """Write the centre camera's images and the labels as a tub.

    The steering becomes the angle to the bit. Donkeycar's throttle is throttle minus brake, its
    speed is in m/s; the recorded values are kept under keys of drivezoo. Images are hard links.

    Raises:
        InputError: no image is whole, `out` exists, or the disk is full.
    """
    with whole_folder(out) as part:
        (part / IMAGES).mkdir()
        kept, left_out = whole_rows(recording, cameras=1)
        drives, time_s = continuous_drives(kept), complete_times(kept)
        drive = np.repeat(np.arange(len(drives)), [len(rows_of_drive) for rows_of_drive in drives])
        day = time.strftime("%y-%m-%d", time.gmtime(time_s[0]))
        sessions = [f"{day}_{number}" for number in range(len(drives))]
        lines = []
        for row in reported(range(len(kept)), progress):
            target = part / IMAGES / f"{row}_{IMAGE.replace('/', '_')}_"
            image = put_image(kept.images[row, 0], target, kept.place(row), quality=options.quality)
            exact = {key: float(getattr(kept, name)[row]) for name, key in EXACT.items()}
            record = {
                IMAGE: image.removeprefix(f"{IMAGES}/"),
                ANGLE: float(kept.steering[row]),
                THROTTLE: exact[EXACT["throttle"]] - exact[EXACT["brake"]],
                MODE: "user",
                SPEEDS_MPS[0]: exact[EXACT["speed_mph"]] * MPS_PER_MPH,
                **exact,
                "_index": row,
                "_session_id": sessions[drive[row]],
                "_timestamp_ms": round(time_s[row] * 1000),
            }
            lines.append(json.dumps(record, allow_nan=False, sort_keys=True) + "\n")
        write_catalogs(part, lines, sessions, float(time_s[0]))
        write_car(part, recording)
    notes = left_out_note(left_out, "their image is damaged")
    if any(path is not None for path in recording.images[:, 1:].flat):
        notes.append("a tub has one camera: the side cameras are left out")
    following = ("donkey", "train", "--tub", str(out.absolute()))
    return Converted(out, len(kept), len(drives), tuple(notes), following, "in your car's folder")


def write_catalogs(folder: Path, lines: list[str], sessions: list[str], created_s: float) -> None:
    """Write a tub's manifest and catalogs from its records' lines."""
    names: list[str] = []
    for first in range(0, len(lines), CATALOG_ROWS):
        rows = lines[first : first + CATALOG_ROWS]
        names.append(f"catalog_{len(names)}.catalog")
        _write_text(folder / names[-1], "".join(rows))
        about = {
            "created_at": created_s,
            "line_lengths": [len(row) for row in rows],
            "path": f"{names[-1]}_manifest",
            "start_index": first,
        }
        _write_text(folder / f"{names[-1]}_manifest", json.dumps(about) + "\n")
    session = {"all_full_ids": sessions, "last_full_id": sessions[-1], "last_id": len(sessions) - 1}
    manifest = [
        list(TYPES),
        list(TYPES.values()),
        {},
        {"created_at": created_s, "sessions": session},
        {
            "paths": names,
            "current_index": len(lines),
            "max_len": CATALOG_ROWS,
            "deleted_indexes": [],
        },
    ]
    _write_text(folder / MANIFEST, "".join(f"{json.dumps(row)}\n" for row in manifest))


def _write_text(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8", newline="\n")

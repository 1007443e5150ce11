"""Read a Donkeycar tub: `manifest.json` with catalogs (Donkeycar 4 and 5), or `record_*.json`.

Written after the format of `donkeycar/parts/tub_v2.py` and `datastore_v2.py` (version 5.3), and
`datastore.py` of version 3.
"""

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from datamodules.bad_rows import BadRows
from datamodules.exchange.converted import Converted, left_out_note
from datamodules.exchange.driven_rows import (
    IMAGE_FOLDER,
    DrivenRows,
    Fit,
    copy_image,
    size_note,
    times_of_drives,
    write_log,
)
from datamodules.exchange.json_fields import number, parse, plain_name
from datamodules.image import MOST_IMAGE_BYTES, image_size
from datamodules.image_files import find_file_fault
from datamodules.source_format import MANIFEST, old_records, write_source
from zoo.base.bounded_files import MOST_JSON_BYTES, read_text
from zoo.base.errors import InputError
from zoo.base.limits import check_most
from zoo.base.new_folder import RECORDINGS, whole_folder
from zoo.base.regular_file import open_binary, open_text
from zoo.base.rig import MPS_PER_MPH

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
REPORT_ROWS = 50  # rows between two calls of `progress`


@dataclass(frozen=True, slots=True)
class _Record:
    place: str
    image: str
    steering: float
    throttle: float
    brake: float
    speed_mph: float
    time_s: float  # NaN if unknown
    session: str


@dataclass(frozen=True)
class _Tub:
    records: list[_Record]
    deleted: int
    piloted: int
    has_speed: bool
    is_own: bool  # drivezoo wrote it, from a recording of Udacity's rig


def import_tub(
    folder: Path,
    out: Path,
    fit: Fit = "keep",
    quality: int = 95,
    progress: Callable[[float], None] = lambda share: None,
    on_bad_row: str = "fail",
) -> Converted:
    """Write a tub's records as a recording.

    Records that the tub marks as deleted, that an autopilot drove, or whose image is damaged are
    left out. The angle becomes the steering. A throttle below 0 stays; the brake is 0.

    Args:
        folder: folder of the tub.
        out: new folder.
        fit: `keep` links the images as they are; `pad` writes them with black bars, 2 to 1.
        quality: quality of padded JPEGs, 1..100.
        progress: function called with the finished share, 0..1.
        on_bad_row: `fail`, or `skip` a record that cannot be read.

    Raises:
        InputError: a file is missing or damaged, a value is wrong, nothing is left, or `out`
            exists.
    """
    with whole_folder(out, RECORDINGS) as part:
        bad = BadRows(on_bad_row)
        tub = _read_tub(folder, bad)
        (part / IMAGE_FOLDER).mkdir()
        whole, faults = [], []
        for row, record in enumerate(tub.records):
            fault = find_file_fault(record.image)
            if fault:
                faults.append(f"{record.place}: {fault}")
            else:
                whole.append(row)
        if not whole and not bad.faults:
            reason = faults[0] if faults else "all records are deleted or driven by an autopilot"
            raise InputError(f"{folder}: no record is left: {reason}; name another tub")
        rows = _rows(tub.records).keep(whole)
        good = rows.good_rows(bad)
        rows, whole = rows.keep(good), [whole[row] for row in good]
        names = []
        for count, (row, stem) in enumerate(zip(whole, rows.stems(), strict=True)):
            if count % REPORT_ROWS == 0:
                progress(count / len(whole))
            source = tub.records[row].image
            suffix = ".png" if fit == "keep" and _is_png(source) else ".jpg"
            names.append(f"center_{stem}{suffix}")
            try:
                copy_image(source, part / IMAGE_FOLDER / names[-1], quality, fit)
            except ValueError as error:
                raise InputError(
                    f"{rows.places[count]}: {source}: {error}; delete the record"
                ) from None
        write_log(part, rows, [(name, "", "") for name in names])
        if not tub.is_own:
            write_source(part, "donkeycar")
        notes = left_out_note(bad.faults, "they cannot be read")
        notes += left_out_note(faults, "their image is damaged or missing")
        if tub.deleted:
            notes.append(f"{tub.deleted:,} records left out that the tub marks as deleted")
        if tub.piloted:
            notes.append(f"{tub.piloted:,} records left out that an autopilot drove")
        if not tub.has_speed:
            notes.append("the tub has no speed: the log has 0 mph in each row")
        notes += size_note(*_size(tub.records[whole[0]].image), fit)
    return Converted(out, len(rows), rows.drives(), tuple(notes))


def _read_tub(folder: Path, bad: BadRows) -> _Tub:
    """Return the tub's records; records that cannot be read go to `bad`."""
    texts = _new_records(folder) if (folder / MANIFEST).exists() else _old_records(folder)
    records, deleted, piloted, has_speed, is_own = [], 0, 0, False, False
    for count, (place, text, images) in enumerate(texts, 1):
        check_most("rows", count, folder, "divide the tub")
        if text is None:
            deleted += 1
            continue
        try:
            found = parse(text, place, dict)
            if found.get(MODE, "user") != "user":
                piloted += 1
                continue
            records.append(_record(place, found, images))
        except InputError as error:
            bad.faults.append(str(error).rpartition("; ")[0])  # `finish` has the remedy
            continue
        has_speed = has_speed or any(key in found for key in (*SPEEDS_MPS, EXACT["speed"]))
        is_own = is_own or EXACT["speed"] in found
    return _Tub(records, deleted, piloted, has_speed, is_own)


def _record(place: str, found: dict, images: str) -> _Record:
    throttle = number(found, THROTTLE, place, 0.0)
    speed_key = next((key for key in SPEEDS_MPS if key in found), SPEEDS_MPS[0])
    speed_mph = abs(number(found, speed_key, place, 0.0)) / MPS_PER_MPH
    time_s = np.nan
    if "_timestamp_ms" in found:
        time_s = number(found, "_timestamp_ms", place) / 1000
    elif "milliseconds" in found:
        time_s = number(found, "milliseconds", place) / 1000
    return _Record(
        place=place,
        image=images + plain_name(found.get(IMAGE), place, IMAGE),
        steering=number(found, ANGLE, place),
        throttle=number(found, EXACT["throttle"], place, throttle),
        brake=number(found, EXACT["brake"], place, 0.0),
        speed_mph=number(found, EXACT["speed"], place, speed_mph),
        time_s=time_s,
        session=str(found.get("_session_id", "")),
    )


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
    for _, path in sorted(old_records(folder)):
        with open_text(path, MOST_JSON_BYTES, errors="surrogateescape") as file:
            yield str(path), file.read(), images


def _rows(records: list[_Record]) -> DrivenRows:
    def column(name: str) -> np.ndarray:
        return np.array([getattr(one, name) for one in records], dtype=float)

    time_s = column("time_s")
    sessions = {one: index for index, one in enumerate(dict.fromkeys(r.session for r in records))}
    drive = np.array([sessions[one.session] for one in records])
    if np.isnan(time_s).any():
        time_s = times_of_drives(drive, np.arange(len(records)) / LOOP_HZ)
    return DrivenRows(
        steering=column("steering"),
        throttle=column("throttle"),
        brake=column("brake"),
        speed_mph=column("speed_mph"),
        time_s=time_s,
        places=[one.place for one in records],
    )


def _is_png(path: str) -> bool:
    with open_binary(path, MOST_IMAGE_BYTES) as file:
        return file.read(4) == b"\x89PNG"


def _size(path: str) -> tuple[int, int]:
    with open_binary(path, MOST_IMAGE_BYTES) as file:
        try:
            return image_size(file)
        except ValueError:
            return 2, 1  # its reader will report it

"""Write a recording as a Donkeycar tub, which `donkey train --tub` reads.

Written after the format of `donkeycar/parts/tub_v2.py` and `datastore_v2.py` (version 5.3).
"""

import json
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from datamodules.formats.donkeycar import (
    ANGLE,
    EXACT,
    IMAGE,
    IMAGES,
    MANIFEST,
    MODE,
    SPEEDS_MPS,
    THROTTLE,
)
from datamodules.formats.recording_writer import Converted, left_out_note
from datamodules.image_files import find_file_fault, link_or_copy
from datamodules.recording import Recording
from datamodules.stretches import complete_times, continuous_drives
from zoo.base.errors import InputError
from zoo.base.new_folder import RECORDINGS, whole_folder
from zoo.base.rig import MPS_PER_MPH

CATALOG_ROWS = 1000  # records in a catalog, as Donkeycar writes them
REPORT_ROWS = 50  # rows between two calls of `progress`
SPEED = SPEEDS_MPS[0]
TYPES = {
    IMAGE: "image_array",
    ANGLE: "float",
    THROTTLE: "float",
    MODE: "str",
    SPEED: "float",
    **{key: "float" for key in EXACT.values()},
}


def export_tub(
    recording: Recording, out: Path, progress: Callable[[float], None] = lambda share: None
) -> Converted:
    """Write the centre camera's images and the labels as a tub.

    The steering becomes the angle to the bit. Donkeycar's throttle is throttle minus brake, its
    speed is in m/s; the recorded values are kept under keys of drivezoo. Images are hard links.

    Args:
        recording: recording to write.
        out: new folder.
        progress: function called with the finished share, 0..1.

    Raises:
        InputError: no image is whole, `out` exists, or the disk is full.
    """
    with whole_folder(out, RECORDINGS) as part:
        (part / IMAGES).mkdir()
        faults = [find_file_fault(path) for path in recording.images[:, 0]]
        left_out = [f"{recording.place(row)}: {one}" for row, one in enumerate(faults) if one]
        kept = recording.keep(np.array([one is None for one in faults]))
        if not len(kept):
            raise InputError(f"no row has a whole image: {left_out[0]}; copy the images again")
        drives = continuous_drives(kept)
        drive = np.repeat(np.arange(len(drives)), [len(one) for one in drives])
        time_s = complete_times(kept)
        day = time.strftime("%y-%m-%d", time.gmtime(time_s[0]))
        sessions = [f"{day}_{number}" for number in range(len(drives))]
        lines = []
        for row in range(len(kept)):
            if row % REPORT_ROWS == 0:
                progress(row / len(kept))
            path = kept.images[row, 0]
            suffix = ".png" if path.lower().endswith(".png") else ".jpg"
            name = f"{row}_{IMAGE.replace('/', '_')}_{suffix}"
            link_or_copy(path, part / IMAGES / name)
            record = _record(kept, row) | {
                IMAGE: name,
                "_index": row,
                "_session_id": sessions[drive[row]],
                "_timestamp_ms": round(time_s[row] * 1000),
            }
            lines.append(json.dumps(record, allow_nan=False, sort_keys=True))
        _write_catalogs(part, lines, sessions, float(time_s[0]))
    notes = left_out_note(left_out, "their image is damaged")
    if any(path is not None for path in recording.images[:, 1:].flat):
        notes.append("a tub has one camera: the side cameras are left out")
    return Converted(out, len(kept), len(drives), tuple(notes))


def _record(recording: Recording, row: int) -> dict:
    throttle, brake = float(recording.throttle[row]), float(recording.brake[row])
    speed_mph = float(recording.speed_mph[row])
    return {
        ANGLE: float(recording.steering[row]),
        THROTTLE: throttle - brake,
        MODE: "user",
        SPEED: speed_mph * MPS_PER_MPH,
        EXACT["throttle"]: throttle,
        EXACT["brake"]: brake,
        EXACT["speed"]: speed_mph,
    }


def _write_catalogs(folder: Path, lines: list[str], sessions: list[str], created_s: float) -> None:
    names: list[str] = []
    for first in range(0, len(lines), CATALOG_ROWS):
        rows = lines[first : first + CATALOG_ROWS]
        stem = f"catalog_{len(names)}"
        names.append(f"{stem}.catalog")
        (folder / names[-1]).write_text(
            "".join(f"{one}\n" for one in rows), newline="\n", encoding="utf-8"
        )
        about = folder / f"{stem}.catalog_manifest"
        lengths = [len(one) + 1 for one in rows]
        contents = {"created_at": created_s, "line_lengths": lengths, "path": about.name}
        _write_lines(about, [contents | {"start_index": first}])
    session = {"all_full_ids": sessions, "last_full_id": sessions[-1], "last_id": len(sessions) - 1}
    catalogs = {
        "paths": names,
        "current_index": len(lines),
        "max_len": CATALOG_ROWS,
        "deleted_indexes": [],
    }
    metadata = {"created_at": created_s, "sessions": session}
    about_keys = [list(TYPES), list(TYPES.values())]
    _write_lines(folder / MANIFEST, [*about_keys, {}, metadata, catalogs])


def _write_lines(path: Path, rows: list) -> None:
    text = "".join(f"{json.dumps(one, sort_keys=True)}\n" for one in rows)
    path.write_text(text, encoding="ascii", newline="\n")

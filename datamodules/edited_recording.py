"""Write an edited recording as a new folder; the recorded one stays as it is.

An image of the new folder is a hard link to the recorded file where the file system allows it, else
a copy. So the new folder loads on its own, also after the recorded one was moved or deleted, and
takes no space for images. Only a mirrored image is a new file.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from datamodules.driving_log import CAMERAS
from datamodules.formats.recording_writer import write_frame, write_log
from datamodules.image import (
    AnyImage,
    find_file_fault,
    link_or_copy,
    read_image,
)
from datamodules.recording import IMAGE_FOLDER, Recording, file_name
from datamodules.recording_edits import Edits, edit_options
from datamodules.recording_format import read_source, write_source
from zoo.base.errors import InputError
from zoo.base.new_folder import RECORDINGS, whole_folder

EDITS_NAME = "edits.json"
REPORT_ROWS = 50  # rows between two calls of `progress`


@dataclass(frozen=True)
class WrittenRecording:
    """A written recording.

    Attributes:
        folders: folder of each part.
        rows: number of rows in each part.
        left_out: a line for each row that was left out because of a bad image.
    """

    folders: tuple[Path, ...]
    rows: tuple[int, ...]
    left_out: tuple[str, ...] = ()


def write_edited(
    recording: Recording,
    edits: Edits,
    out: Path,
    progress: Callable[[float], None] = lambda share: None,
) -> WrittenRecording:
    """Write the kept rows to a new folder, or to the folders 1, 2, ... in it if there are splits.

    The folder appears when it is complete. `edits.json` in it names the sources and the edits.

    Args:
        recording: recording to edit.
        edits: edits of its rows.
        out: new folder.
        progress: function called with the written share, 0..1.

    Raises:
        InputError: `out` exists, nothing is kept, a mirrored image cannot be read, or the disk is
            full; nothing is left at `out`.
    """
    out = out.expanduser().absolute()
    parts = edits.parts()
    if not parts:
        raise InputError("all rows are dropped; restore some before you write")
    total = sum(len(rows) for rows, _ in parts)
    counts, left_out, done = [], [], 0

    def report(before: int, written: int) -> None:
        progress((before + written) / total)

    with whole_folder(out, RECORDINGS) as part:
        places = [part] if len(parts) == 1 else [part / str(one + 1) for one in range(len(parts))]
        for place, (rows, mirrored) in zip(places, parts, strict=True):
            count, faults = _write_part(recording, place, rows, mirrored, partial(report, done))
            if source := read_source(recording.names):
                write_source(place, source)
            counts.append(count)
            left_out += faults
            done += len(rows)
        if not all(counts):
            raise InputError(f"no row with whole images is left: {left_out[0]}")
        about = {
            "version": 1,
            "sources": list(recording.names),
            "fingerprint": recording.fingerprint(),
            "rows": edits.rows,
            "kept": int(edits.kept().sum()),
            "edits": edit_options(edits),
        }
        (part / EDITS_NAME).write_text(json.dumps(about, indent=2) + "\n", encoding="utf-8")
    folders = tuple(out / place.relative_to(part) for place in places)
    return WrittenRecording(folders, tuple(counts), tuple(left_out))


def _write_part(
    recording: Recording,
    folder: Path,
    rows: np.ndarray,
    mirrored: np.ndarray,
    report: Callable[[int], None],
) -> tuple[int, list[str]]:
    """Write a folder: images, then the log. Return its rows, and a line on each left-out row."""
    (folder / IMAGE_FOLDER).mkdir(parents=True)
    names: dict[tuple[str, bool], str] = {}
    written: list[tuple[list[str], list[float]] | None] = []
    left_out, before = [], None
    for number, (row, turned) in enumerate(zip(rows.tolist(), mirrored.tolist(), strict=True)):
        if number % REPORT_ROWS == 0:
            report(number)
        paths = recording.images[row].tolist()
        if fault := next(
            filter(None, (find_file_fault(path) for path in paths if isinstance(path, str))), None
        ):
            left_out.append(f"{recording.place(row)}: {fault}")
            continue
        # Where rows are missing and no time shows it, an empty line does: no window reaches over.
        if before is not None and np.isnan(recording.time_s[[before, row]]).any():
            is_next = recording.recording[row] == recording.recording[before]
            written += [] if row == before + 1 and is_next else [None]
        before = row
        if turned:
            paths = [paths[0], paths[2], paths[1]]  # the left camera sees what the right one saw
        for camera, path in zip(CAMERAS, paths, strict=True):
            if path and (path, turned) not in names:
                stored = not isinstance(path, str)
                name = f"{path.number + 1}.jpg" if stored else file_name(path)
                name = f"{camera}_mirrored_{name}" if turned else name
                target = free_name(folder / IMAGE_FOLDER / name)
                names[path, turned] = f"{IMAGE_FOLDER}/{target.name}"
                if turned or stored:
                    _write_image(path, target, recording.place(row), turned)
                else:
                    link_or_copy(path, target)
        steering = -recording.steering[row] + 0.0 if turned else recording.steering[row]
        others = (recording.throttle[row], recording.brake[row], recording.speed_mph[row])
        images = [names[path, turned] if path else "" for path in paths]
        written.append((images, [steering, *others]))
    write_log(folder, written)
    return len(written) - written.count(None), left_out


def free_name(path: Path) -> Path:
    """Return a file that does not exist; its name ends as the given one, which has the time."""
    number, found = 1, path
    while found.exists():
        number += 1
        found = path.with_name(f"{number}_{path.name}")
    return found


def _write_image(image: AnyImage, target: Path, place: str, mirrored: bool) -> None:
    try:
        pixels = read_image(image)
    except ValueError as error:
        raise InputError(f"{place}: {image}: {error}; drop the row") from None
    write_frame(pixels[:, ::-1] if mirrored else pixels, target)

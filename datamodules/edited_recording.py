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
from datamodules.formats.recording_writer import image_stems, put_image, reported, write_log
from datamodules.formats.udacity import times_from_names
from datamodules.image import find_file_fault
from datamodules.recorded_car import write_car
from datamodules.recording import IMAGE_FOLDER, Recording
from datamodules.recording_edits import Edits, edit_options
from datamodules.stretches import missing_rows
from zoo.base.errors import InputError
from zoo.base.new_folder import whole_folder

EDITS_NAME = "edits.json"


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

    def report(before: int, rows: int, share: float) -> None:
        progress((before + share * rows) / total)

    with whole_folder(out) as part:
        paths = [part] if len(parts) == 1 else [part / str(at + 1) for at in range(len(parts))]
        for folder, (rows, mirrored) in zip(paths, parts, strict=True):
            count, faults = _write_part(
                recording, folder, rows, mirrored, partial(report, done, len(rows))
            )
            write_car(folder, recording)
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
    folders = tuple(out / folder.relative_to(part) for folder in paths)
    return WrittenRecording(folders, tuple(counts), tuple(left_out))


def _write_part(
    recording: Recording,
    folder: Path,
    rows: np.ndarray,
    mirrored: np.ndarray,
    report: Callable[[float], None],
) -> tuple[int, list[str]]:
    """Write a folder: images, then the log. Return its rows, and a line on each left-out row."""
    (folder / IMAGE_FOLDER).mkdir(parents=True)
    names: dict[tuple[str, bool], str] = {}
    written: list[tuple[list[str], list[float]] | None] = []
    left_out, before = [], None
    # A log's times are those of its images' names.
    stems = image_stems(np.nan_to_num(recording.time_s))
    named = times_from_names([str(image) for image in recording.images[:, 0]])
    is_renamed = np.isfinite(recording.time_s) & ~(np.abs(named - recording.time_s) < 0.001)
    is_last = missing_rows(recording)
    for row, turned in reported(list(zip(rows.tolist(), mirrored.tolist(), strict=True)), report):
        images = recording.images[row].tolist()
        if fault := next(filter(None, map(find_file_fault, images)), None):
            left_out.append(f"{recording.place(row)}: {fault}")
            continue
        # Where rows are missing there is an empty line: no window reaches over it.
        if written and (before != (row - 1, turned) or is_last[row - 1]):
            written.append(None)
        before = row, turned
        if turned:
            images = [images[0], images[2], images[1]]  # the left camera sees what the right saw
        for camera, image in zip(CAMERAS, images, strict=True):
            if image and (is_renamed[row] or (image, turned) not in names):
                name = Path(image).stem if isinstance(image, str) else str(image.number + 1)
                name = f"{camera}_{stems[row]}" if is_renamed[row] else name
                name = f"{camera}_mirrored_{name}" if turned else name
                target, change = folder / IMAGE_FOLDER / name, np.fliplr if turned else None
                names[image, turned] = put_image(image, target, recording.place(row), change)
        steering = -recording.steering[row] + 0.0 if turned else recording.steering[row]
        others = (recording.throttle[row], recording.brake[row], recording.speed_mph[row])
        paths = [names[image, turned] if image else "" for image in images]
        written.append((paths, [steering, *others]))
    write_log(folder, written)
    return len(written) - written.count(None), left_out

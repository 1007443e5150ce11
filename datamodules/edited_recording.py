"""Write an edited recording as a new folder; the recorded one stays as it is.

An image of the new folder is a hard link to the recorded file where the file system allows it, else
a copy. So the new folder loads on its own, also after the recorded one was moved or deleted, and
takes no space for images. Only a mirrored image is a new file.
"""

import csv
import io
import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from datamodules.driving_log import CAMERAS, number_text
from datamodules.image import find_file_fault, link_or_copy, read_image
from datamodules.recording import LOG_NAME, Recording, file_name, read_source, write_source
from datamodules.recording_edits import Edits, edit_options
from zoo.base.errors import InputError
from zoo.base.new_folder import RECORDINGS, whole_folder

IMAGE_FOLDER, EDITS_NAME = "IMG", "edits.json"
MIRRORED_QUALITY = 95  # of a JPEG
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
    with whole_folder(out, RECORDINGS) as part:
        places = [part] if len(parts) == 1 else [part / str(one + 1) for one in range(len(parts))]
        for place, (rows, mirrored) in zip(places, parts, strict=True):
            before = done

            def report(written: int, before: int = before) -> None:
                progress((before + written) / total)

            writer = _PartWriter(recording, place)
            writer.write(rows, mirrored, report)
            if source := read_source(recording.names):
                write_source(place, source)
            counts.append(writer.rows)
            left_out += writer.left_out
            done += len(rows)
        if not all(counts):
            raise InputError(f"no row with whole images is left: {left_out[0]}")
        text = json.dumps(_provenance(recording, edits), indent=2) + "\n"
        (part / EDITS_NAME).write_text(text, encoding="utf-8")
    folders = tuple(out / place.relative_to(part) for place in places)
    return WrittenRecording(folders, tuple(counts), tuple(left_out))


@dataclass
class _PartWriter:
    """A writer of one folder: images, then the log."""

    recording: Recording
    folder: Path
    rows: int = 0
    left_out: list[str] = field(default_factory=list)

    def write(self, rows: np.ndarray, mirrored: np.ndarray, report: Callable[[int], None]) -> None:
        (self.folder / IMAGE_FOLDER).mkdir(parents=True)
        self._names: dict[tuple[str, bool], str] = {}
        self._taken: set[str] = set()
        text = io.StringIO()
        log = csv.writer(text, lineterminator="\n")
        before = None
        for number, (row, turned) in enumerate(zip(rows.tolist(), mirrored.tolist(), strict=True)):
            if number % REPORT_ROWS == 0:
                report(number)
            paths = self.recording.images[row].tolist()
            fault = next(filter(None, (find_file_fault(path) for path in paths if path)), None)
            if fault:
                self.left_out.append(f"{self.recording.place(row)}: {fault}")
                continue
            if self._follows_unseen_gap(before, row):
                text.write("\n")
            before = row
            log.writerow([*self._images(row, paths, turned), *self._numbers(row, turned)])
            self.rows += 1
        with (self.folder / LOG_NAME).open("x", encoding="utf-8", newline="") as file:
            file.write(text.getvalue())

    def _follows_unseen_gap(self, before: int | None, row: int) -> bool:
        """Return whether rows are missing before a row, and no time shows it.

        An empty line then does: windows of frames do not reach over a missing line.
        """
        one = self.recording
        if before is None or not np.isnan(one.time_s[[before, row]]).any():
            return False
        return row != before + 1 or one.recording[row] != one.recording[before]

    def _images(self, row: int, paths: list[str | None], turned: bool) -> list[str]:
        if turned:
            paths = [paths[0], paths[2], paths[1]]  # the left camera sees what the right one saw
        cameras = zip(CAMERAS, paths, strict=True)
        return [self._image(row, camera, path, turned) if path else "" for camera, path in cameras]

    def _image(self, row: int, camera: str, path: str, turned: bool) -> str:
        """Link, copy or mirror an image; return its path in the log."""
        if (path, turned) not in self._names:
            name = self._free_name(file_name(path), camera if turned else "")
            target = self.folder / IMAGE_FOLDER / name
            if turned:
                _mirror_image(path, target, self.recording.place(row))
            else:
                link_or_copy(path, target)
            self._names[path, turned] = f"{IMAGE_FOLDER}/{name}"
        return self._names[path, turned]

    def _free_name(self, name: str, camera: str) -> str:
        """Return a name that is not taken; it ends as the recorded one, which has the time."""
        if camera:
            first = next((one for one in CAMERAS if name.startswith(f"{one}_")), "")
            name = f"{camera}_mirrored_{name.removeprefix(f'{first}_')}"
        found, number = name, 1
        while found in self._taken:
            number += 1
            found = f"{number}_{name}"
        self._taken.add(found)
        return found

    def _numbers(self, row: int, turned: bool) -> list[str]:
        one = self.recording
        steering = -one.steering[row] + 0.0 if turned else one.steering[row]
        numbers = (steering, one.throttle[row], one.brake[row], one.speed_mph[row])
        return [number_text(number) for number in numbers]


def _mirror_image(path: str, target: Path, place: str) -> None:
    try:
        image = read_image(path)
    except ValueError as error:
        raise InputError(f"{place}: {path}: {error}; drop the row") from None
    kind = ".png" if path.lower().endswith(".png") else ".jpg"
    flipped = np.ascontiguousarray(image[:, ::-1, ::-1])  # RGB to OpenCV's BGR
    quality = [cv2.IMWRITE_JPEG_QUALITY, MIRRORED_QUALITY] if kind == ".jpg" else []
    target.write_bytes(cv2.imencode(kind, flipped, quality)[1].tobytes())


def _provenance(recording: Recording, edits: Edits) -> dict:
    return {
        "version": 1,
        "sources": list(recording.names),
        "fingerprint": recording.fingerprint(),
        "rows": edits.rows,
        "kept": int(edits.kept().sum()),
        "edits": edit_options(edits),
    }

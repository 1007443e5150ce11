"""Write a recording of any format as a `driving_log.csv` with an `IMG` folder."""

import csv
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from datamodules.driving_log import CAMERAS, number_text
from datamodules.image import (
    decode_image,
    encode_image,
    find_fault,
    find_file_fault,
    link_or_copy,
)
from datamodules.read_options import ReadOptions
from datamodules.recording import IMAGE_FOLDER, LOG_NAME, Recording
from datamodules.recording_format import read_recording, write_source
from datamodules.stretches import complete_times, find_breaks
from zoo.base.errors import InputError
from zoo.base.new_folder import RECORDINGS, whole_folder
from zoo.base.rig import UDACITY
from zoo.base.whole_file import write_new

REPORT_EVERY = 50  # images between two calls of `progress`
PNG = b"\x89PNG"

Fit = Literal["keep", "pad"]


@dataclass(frozen=True)
class Converted:
    """A converted recording.

    Attributes:
        folder: folder that was written.
        rows: number of rows in it.
        drives: number of continuous drives.
        notes: a line on each loss or assumption.
    """

    folder: Path
    rows: int
    drives: int
    notes: tuple[str, ...] = ()


def left_out_note(left_out: Iterable[str], what: str) -> list[str]:
    """Return a note on rows that were left out, or none."""
    faults = list(left_out)
    if not faults:
        return []
    return [f"{len(faults):,} rows left out: {what} (the first: {faults[0]})"]


def whole_rows(recording: Recording, cameras: int = len(CAMERAS)) -> tuple[Recording, list[str]]:
    """Return the rows whose images, of the first cameras, are whole; and a line on each other.

    Raises:
        InputError: no row is left.
    """
    left_out, mask = [], np.ones(len(recording), bool)
    for row, paths in enumerate(recording.images[:, :cameras].tolist()):
        if fault := next(filter(None, (find_file_fault(path) for path in paths if path)), None):
            left_out.append(f"{recording.place(row)}: {fault}")
            mask[row] = False
    if not mask.any():
        raise InputError(f"no row has whole images: {left_out[0]}; copy the images again")
    return recording.keep(mask), left_out


def write_recording(
    recording: Recording,
    out: Path,
    source: str,
    fit: Fit = "keep",
    quality: int = 95,
    progress: Callable[[float], None] = lambda share: None,
) -> Converted:
    """Write a recording's rows as a log with images.

    Image files are linked or copied as they are, unless they are padded.

    Args:
        recording: recording to write.
        out: new folder.
        source: name of the recording's format.
        fit: `keep`, or `pad` images with black bars to twice as wide as high.
        quality: quality of the JPEGs that are encoded, 1..100.
        progress: function called with the finished share, 0..1.

    Raises:
        InputError: an image cannot be read, `out` exists, or the disk is full.
    """
    stems = image_stems(complete_times(recording))
    written = np.full(recording.images.shape, "", object)
    order = _reading_order(recording)
    with whole_folder(out, RECORDINGS) as part:
        (part / IMAGE_FOLDER).mkdir()
        for count, (row, camera) in enumerate(order):
            if count % REPORT_EVERY == 0:
                progress(count / len(order))
            stem = f"{IMAGE_FOLDER}/{CAMERAS[camera]}_{stems[row]}"
            written[row, camera] = _write_image(recording, row, camera, part, stem, fit, quality)
        columns = (recording.steering, recording.throttle, recording.brake, recording.speed_mph)
        write_log(part, zip(written.tolist(), np.stack(columns, 1).tolist(), strict=True))
        if recording.rig != UDACITY:
            write_source(part, source)
    notes = [
        *left_out_note(recording.bad_rows, "they cannot be read"),
        *left_out_note(recording.bad_images, "their image is damaged or missing"),
        *recording.notes,
    ]
    drives = 1 + int(find_breaks(recording).sum())
    return Converted(out, len(recording), drives, tuple(notes))


def convert_to_recording(
    source: Path, out: Path, options: ReadOptions | None = None, **how: Any
) -> Converted:
    """Read a folder of any format and write it as a log; `how` as in `write_recording`."""
    name, recording = read_recording(source, options or ReadOptions())
    return write_recording(recording, out, name, **how)


def image_stems(time_s: np.ndarray) -> list[str]:
    """Return a file name's part for each row, which ends in the time and is unique."""
    moments = np.round(time_s * 1000).astype("int64").astype("datetime64[ms]")
    seen: Counter[str] = Counter()
    stems = []
    for text in np.datetime_as_string(moments).tolist():
        stem = text.translate(str.maketrans("-T:.", "____"))
        seen[stem] += 1
        stems.append(f"{seen[stem]}_{stem}" if seen[stem] > 1 else stem)
    return stems


def write_log(folder: Path, rows: Iterable[tuple[list[str], list[float]] | None]) -> None:
    """Write `driving_log.csv`.

    Args:
        folder: folder of the recording.
        rows: paths of centre, left and right, '' without an image, and steering, throttle, brake
            and speed; None for an empty line, over which no window of frames reaches.
    """
    with (folder / LOG_NAME).open("x", encoding="utf-8", newline="") as file:
        log = csv.writer(file, lineterminator="\n")
        for row in rows:
            log.writerow([*row[0], *map(number_text, row[1])] if row else [])


def write_frame(image: np.ndarray, target: Path, quality: int = 95, fit: Fit = "keep") -> None:
    """Write an image, uint8 [H, W, 3] RGB, as a new PNG or a JPEG of this quality, 1..100.

    OpenCV's own writer ends the process for a path that is not UTF-8.
    """
    image = pad_to_two_by_one(image) if fit == "pad" else image
    write_new(target, encode_image(image, target.suffix, quality))


def pad_to_two_by_one(image: np.ndarray) -> np.ndarray:
    """Return an image with black bars that make it twice as wide as high.

    >>> pad_to_two_by_one(np.zeros((120, 160, 3), np.uint8)).shape
    (120, 240, 3)
    """
    height, width = image.shape[:2]
    rows, columns = max(height, -(-width // 2)), max(width, 2 * height)
    top, left = (rows - height) // 2, (columns - width) // 2
    around = ((top, rows - height - top), (left, columns - width - left), (0, 0))
    return np.pad(image, around)


def _reading_order(recording: Recording) -> list[tuple[int, int]]:
    """Return row and camera of each image: camera by camera, each file from its beginning."""

    def place(at: tuple[int, int]) -> tuple[int, str, int]:
        image = recording.images[at]
        return at[1], getattr(image, "file", ""), getattr(image, "number", at[0])

    rows, cameras = np.nonzero(recording.images.astype(bool))
    return sorted(zip(rows.tolist(), cameras.tolist(), strict=True), key=place)


def _write_image(
    recording: Recording, row: int, camera: int, folder: Path, stem: str, fit: Fit, quality: int
) -> str:
    """Write an image as it is, or padded, or a video's frame; return its path in the folder."""
    image = recording.images[row, camera]
    try:
        stored = recording.stored(row, camera)
        if fit == "keep" and isinstance(stored, bytes):
            if fault := find_fault(stored):
                raise ValueError(fault)
            path = f"{stem}{'.png' if stored.startswith(PNG) else '.jpg'}"
            if isinstance(image, str):
                link_or_copy(image, folder / path)
            else:
                write_new(folder / path, stored)
            return path
        pixels = decode_image(stored) if isinstance(stored, bytes) else stored
    except ValueError as error:
        name = image if isinstance(image, str) else image.file
        place = recording.place(row)
        raise InputError(f"{place}: {name}: {error}; delete the row") from None
    write_frame(pixels, folder / f"{stem}.jpg", quality, fit)
    return f"{stem}.jpg"

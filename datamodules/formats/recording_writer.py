"""Write a recording of any format as a `driving_log.csv` with an `IMG` folder."""

import csv
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np

from datamodules.driving_log import CAMERAS, number_text
from datamodules.image import (
    AnyImage,
    decode_image,
    encode_image,
    find_fault,
    find_file_fault,
    link_or_copy,
    read_ends,
    read_stored,
)
from datamodules.read_options import ReadOptions
from datamodules.recording import IMAGE_FOLDER, LOG_NAME, Recording
from datamodules.recording_format import read_recording, write_car
from datamodules.stretches import complete_times, find_breaks
from zoo.base.errors import InputError
from zoo.base.new_folder import whole_folder
from zoo.base.whole_file import write_new

REPORT_EVERY = 50  # items between two calls of `progress`
PNG = b"\x89PNG"

Fit = Literal["keep", "pad"]
Item = TypeVar("Item")


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


def reported(items: Sequence[Item], progress: Callable[[float], None]) -> Iterator[Item]:
    """Yield items; call `progress` with the finished share, 0..1."""
    for number, item in enumerate(items):
        if number % REPORT_EVERY == 0:
            progress(number / len(items))
        yield item


def left_out_note(faults: Sequence[str], what: str) -> list[str]:
    """Return a note on rows that were left out, or none."""
    return [f"{len(faults):,} rows left out: {what} (the first: {faults[0]})"] if faults else []


def whole_rows(recording: Recording, cameras: int = len(CAMERAS)) -> tuple[Recording, list[str]]:
    """Return the rows whose images, of the first cameras, are whole; and a line on each other.

    Raises:
        InputError: no row is left.
    """
    left_out, mask = [], np.ones(len(recording), bool)
    for row, images in enumerate(recording.images[:, :cameras].tolist()):
        if fault := next(filter(None, map(find_file_fault, images)), None):
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
    change = pad_to_two_by_one if fit == "pad" else None
    with whole_folder(out) as part:
        (part / IMAGE_FOLDER).mkdir()
        for row, camera in reported(_reading_order(recording), progress):
            target = part / IMAGE_FOLDER / f"{CAMERAS[camera]}_{stems[row]}"
            image, place = recording.images[row, camera], recording.place(row)
            written[row, camera] = put_image(image, target, place, change, quality)
        columns = (recording.steering, recording.throttle, recording.brake, recording.speed_mph)
        write_log(part, zip(written.tolist(), np.stack(columns, 1).tolist(), strict=True))
        write_car(part, recording, source, keeps_size=change is None)
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


def write_frame(image: np.ndarray, target: Path, quality: int = 95) -> None:
    """Write an image, uint8 [H, W, 3] RGB, as a new PNG or a JPEG of this quality, 1..100.

    OpenCV's own writer ends the process for a path that is not UTF-8.
    """
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


def put_image(
    image: AnyImage,
    target: Path,
    place: str,
    change: Callable[[np.ndarray], np.ndarray] | None = None,
    quality: int = 95,
) -> str:
    """Write an image as it is stored, or changed, or a video's frame.

    Args:
        image: image file, which is linked or copied, or an image in a larger file.
        target: new file without its suffix, which follows from the contents; a number before its
            name makes the name a new one, if need be.
        place: row, for messages.
        change: function of the pixels, uint8 [H, W, 3] RGB.
        quality: quality of a JPEG that is encoded, 1..100.

    Returns:
        The last folder and the file's name.

    Raises:
        InputError: the image cannot be read.
    """
    is_linked = isinstance(image, str) and change is None
    try:
        stored = read_ends(str(image)) if is_linked else read_stored(image)
        is_png = isinstance(stored, bytes) and stored.startswith(PNG)
        path = free_name(target.with_name(f"{target.name}{'.png' if is_png else '.jpg'}"))
        if isinstance(stored, bytes) and change is None:
            if fault := find_fault(stored):
                raise ValueError(fault)
            link_or_copy(str(image), path) if is_linked else write_new(path, stored)
        else:
            pixels = decode_image(stored) if isinstance(stored, bytes) else stored
            write_frame(change(pixels) if change else pixels, path, quality)
    except ValueError as error:
        raise InputError(
            f"{place}: {getattr(image, 'file', image)}: {error}; delete the row"
        ) from None
    return f"{path.parent.name}/{path.name}"


def free_name(path: Path) -> Path:
    """Return a file that does not exist; its name ends as the given one, which has the time."""
    number, found = 1, path
    while found.exists():
        number += 1
        found = path.with_name(f"{number}_{path.name}")
    return found

"""What the writers of recordings share: chosen and whole rows, images, `driving_log.csv`."""

import csv
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np

from datamodules.driving_log import CAMERAS, number_text
from datamodules.format_options import Progress, WriteOptions
from datamodules.image import (
    AnyImage,
    StoredImage,
    decode_image,
    encode_image,
    find_fault,
    find_file_fault,
    link_or_copy,
    read_ends,
    read_image,
    read_stored,
)
from datamodules.recording import LOG_NAME, Recording
from datamodules.recording_edits import typed_edits
from zoo.base.errors import InputError
from zoo.base.whole_file import write_new

REPORT_EVERY = 50  # items between two calls of `progress`
PNG = b"\x89PNG"

Item = TypeVar("Item")


def reported(items: Sequence[Item], progress: Progress) -> Iterator[Item]:
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


def chosen_recording(
    recording: Recording, options: WriteOptions
) -> tuple[Recording, tuple[str, ...]]:
    """Return the rows of `keep` padded for `fit`, then of `size`, and a line on each change.

    Raises:
        InputError: no row has whole images.
        UsageError: `keep` names no rows of the recording.
    """
    notes: list[str] = []
    if options.keep is not None:
        kept = typed_edits(len(recording), keep_text=options.keep).kept()
        notes.append(f"{int(kept.sum()):,} of {len(recording):,} rows kept: {options.keep}")
        recording = recording.keep(kept)
    if options.size is not None or options.fit == "pad":
        recording, faults = whole_rows(recording)
        notes += left_out_note(faults, "an image is damaged")
        images = recording.images.copy()
        for place, image in np.ndenumerate(images):
            if image:
                file, number = getattr(image, "file", str(image)), getattr(image, "number", 0)
                images[place] = StoredImage(file, number, partial(_changed, image, options))
        # The camera of images in another shape is another one.
        recording = replace(recording, images=images, rig=None, rigs=())
        how = ["padded"] * (options.fit == "pad")
        how += ["resized to {1} x {0}".format(*options.size)] if options.size else []
        notes.append(f"images {' and '.join(how)}: the car's rig is not written")
    if np.isnan(recording.time_s).any():
        notes.append("times are missing: the copy's are made up, evenly spaced in the rows' order")
    return recording, tuple(notes)


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


def put_image(
    image: AnyImage,
    target: Path,
    source: str,
    change: Callable[[np.ndarray], np.ndarray] | None = None,
    quality: int = 95,
) -> str:
    """Write an image as it is stored, or changed, or a video's frame.

    Args:
        image: image file, which is linked or copied, or an image in a larger file.
        target: new file without its suffix, which follows from the contents; a number before its
            name makes the name a new one, if need be.
        source: row, for messages.
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
            f"{source}: {getattr(image, 'file', image)}: {error}; delete the row"
        ) from None
    return f"{path.parent.name}/{path.name}"


def free_name(path: Path) -> Path:
    """Return a file that does not exist; its name ends as the given one, which has the time."""
    number, free = 1, path
    while free.exists():
        number += 1
        free = path.with_name(f"{number}_{path.name}")
    return free


def pad_to_two_by_one(image: np.ndarray) -> np.ndarray:
    """Return an image with black bars that make it twice as wide as high.

    >>> pad_to_two_by_one(np.zeros((120, 160, 3), np.uint8)).shape
    (120, 240, 3)
    """
    height, width = image.shape[:2]
    rows, columns = max(height, -(-width // 2)), max(width, 2 * height)
    top, left = (rows - height) // 2, (columns - width) // 2
    return np.pad(image, ((top, rows - height - top), (left, columns - width - left), (0, 0)))


def _changed(image: AnyImage, options: WriteOptions, *_: object) -> np.ndarray:
    pixels = read_image(image)
    if options.fit == "pad":
        pixels = pad_to_two_by_one(pixels)
    size = options.size or pixels.shape[:2]
    return cv2.resize(pixels, size[::-1], interpolation=cv2.INTER_AREA)

"""Rows that were read from another format, and the log and images written from them."""

import csv
import io
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Literal

import cv2
import numpy as np

from datamodules.bad_rows import BadRows
from datamodules.driving_log import NUMBERS, RANGES, degrees_hint, number_text, range_fault
from datamodules.image import MOST_IMAGE_BYTES, decode_pixels, find_fault
from datamodules.image_files import link_or_copy
from datamodules.recording import GAP_S, LOG_NAME
from zoo.base.regular_file import read_regular
from zoo.base.whole_file import write_new

IMAGE_FOLDER = "IMG"
# Times of rows whose source has none: the log's names need a date.
FIRST_S = 946_684_800.0  # 2000-01-01
PAUSE_S = 10.0  # between two drives without times; longer than a gap
assert PAUSE_S > GAP_S
LAST_S = 253_402_300_800.0  # 10000-01-01: names have four digits for the year

Fit = Literal["keep", "pad"]


@dataclass(frozen=True)
class DrivenRows:
    """Rows of another format in the order of driving.

    Attributes:
        steering, throttle, brake, speed_mph: values as in a log, float64 [N].
        time_s: seconds since 1970, float64 [N].
        places: file and row of each row, for messages.
    """

    steering: np.ndarray
    throttle: np.ndarray
    brake: np.ndarray
    speed_mph: np.ndarray
    time_s: np.ndarray
    places: Sequence[str]

    def __len__(self) -> int:
        return len(self.steering)

    def keep(self, rows: list[int]) -> "DrivenRows":
        """Return these rows alone."""
        columns = [field.name for field in fields(self) if field.name != "places"]
        return DrivenRows(
            **{name: getattr(self, name)[rows] for name in columns},
            places=[self.places[row] for row in rows],
        )

    def good_rows(self, bad: BadRows) -> list[int]:
        """Return the rows with values that a log may have; the others go to `bad`.

        Raises:
            InputError: `bad` refuses the rows.
        """
        numbers = np.stack([self.steering, self.throttle, self.brake, self.speed_mph], axis=1)
        low, high = np.array([RANGES[name] for name in NUMBERS]).T
        within = ((numbers >= low) & (numbers <= high)).all(1)
        timed = (self.time_s >= 0) & (self.time_s < LAST_S)
        for row in np.flatnonzero(~(within & timed)).tolist():
            time = f"the time {self.time_s[row]:g} s is not between 1970 and 9999"
            bad.faults.append(f"{self.places[row]}: {range_fault(numbers[row]) or time}")
        largest = np.abs(self.steering).max(initial=0, where=np.isfinite(self.steering))
        good: list[int] = np.flatnonzero(within & timed).tolist()
        bad.finish(len(good), degrees_hint(largest))
        return good

    def drives(self) -> int:
        """Return the number of drives without a gap, as `drivezoo check` counts gaps."""
        steps = np.diff(self.time_s)
        return 1 + int(((steps > GAP_S) | (steps < 0)).sum())

    def stems(self) -> list[str]:
        """Return a file name's part for each row, which ends in the time and is unique."""
        moments = np.round(self.time_s * 1000).astype("int64").astype("datetime64[ms]")
        texts = np.datetime_as_string(moments).tolist()
        seen: Counter[str] = Counter()
        stems = []
        for text in texts:
            stem = text.translate(str.maketrans("-T:.", "____"))
            seen[stem] += 1
            stems.append(f"{seen[stem]}_{stem}" if seen[stem] > 1 else stem)
        return stems


def times_of_drives(drive: np.ndarray, since_start_s: np.ndarray) -> np.ndarray:
    """Return times for rows whose source has none: drives follow each other with pauses.

    Args:
        drive: number of each row's drive, int [N].
        since_start_s: seconds since the drive's first row, float64 [N].
    """
    times = np.empty(len(drive))
    start = FIRST_S
    for part in np.split(np.arange(len(drive)), np.flatnonzero(np.diff(drive)) + 1):
        times[part] = start + since_start_s[part]
        start = times[part].max(initial=start) + PAUSE_S
    return times


def write_log(folder: Path, rows: DrivenRows, images: Sequence[Sequence[str]]) -> None:
    """Write `driving_log.csv`.

    Args:
        folder: folder of the recording.
        rows: labels.
        images: file names of centre, left and right in `IMG`, '' without an image.
    """
    text = io.StringIO()
    log = csv.writer(text, lineterminator="\n")
    columns = (rows.steering, rows.throttle, rows.brake, rows.speed_mph)
    for names, *numbers in zip(images, *(one.tolist() for one in columns), strict=True):
        paths = [f"{IMAGE_FOLDER}/{name}" if name else "" for name in names]
        log.writerow([*paths, *map(number_text, numbers)])
    with (folder / LOG_NAME).open("x", encoding="utf-8", newline="") as file:
        file.write(text.getvalue())


def write_frame(image: np.ndarray, target: Path, quality: int = 95, fit: Fit = "keep") -> None:
    """Write an image, uint8 [H, W, 3] RGB, as a new JPEG of this quality, 1..100.

    OpenCV's own writer ends the process for a path that is not UTF-8.
    """
    image = pad_to_two_by_one(image) if fit == "pad" else image
    bgr = np.ascontiguousarray(image[:, :, ::-1])
    data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    write_new(target, data.tobytes())


def copy_image(path: str, target: Path, quality: int, fit: Fit) -> None:
    """Link or copy an image file as it is, or write it padded.

    Raises:
        ValueError: the image to pad cannot be decoded.
        OSError: it cannot be read, or the disk is full.
    """
    if fit == "keep":
        link_or_copy(path, target)
    else:
        write_frame(decode_pixels(read_regular(path, MOST_IMAGE_BYTES)), target, quality, fit)


def write_encoded(data: bytes, target: Path, quality: int, fit: Fit) -> None:
    """Write the bytes of a JPEG or PNG as they are, or padded.

    Raises:
        ValueError: the bytes are no JPEG or PNG.
    """
    if fault := find_fault(data[:8], data[-1024:]):
        raise ValueError(fault)
    if fit == "keep":
        target.write_bytes(data)
    else:
        write_frame(decode_pixels(data), target, quality, fit)


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


def size_note(width: int, height: int, fit: Fit) -> list[str]:
    """Return a note on images that every command will stretch, or none."""
    if width == 2 * height or fit == "pad":
        return []
    return [
        f"images are {width} x {height}: every command stretches them to 320 x 160; fit=pad keeps "
        "their shape"
    ]

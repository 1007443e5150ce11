"""Recordings: the rows of a drive and their images, whatever holds the bytes."""

import hashlib
import os
import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from datamodules.driving_log import (
    CAMERAS,
    IMAGE,
    NUMBERS,
    RANGES,
    ROUNDING,
    BadRows,
    range_fault,
    unit_hint,
)
from datamodules.image import Stored, read_image, read_stored
from datamodules.steering_unit import SteeringUnit
from zoo.base.rig import Rig

LOG_NAME, IMAGE_FOLDER = "driving_log.csv", "IMG"
LABELS = ("steering", "throttle", "brake", "speed_mph")
TIMED_LABELS = (*LABELS, "time_s")
LABEL_DECIMALS = 6  # of a fingerprint
MOST_INDEX = 2**53  # up to which float64 has all whole numbers
ROW_SAMPLE = 256  # smallest hashes: a random sample of rows, whose shares are known to 6 %
GAP_S = 1.0  # a longer time between two rows is a gap in the recording
LAST_S = 253_402_300_800.0  # 10000-01-01: image names have four digits for the year


@dataclass(frozen=True)
class Blocks:
    """The blocks of time into which a recording is best split.

    Attributes:
        block_s: length of a block, seconds.
        gap_s: seconds of training rows dropped where blocks of different parts meet.
        why: reason, for the user.
    """

    block_s: float
    gap_s: float
    why: str


SHORT_DRIVES = Blocks(10.0, 1.0, "laps and short drives")
LONG_DRIVE = Blocks(30.0, 3.0, "a long drive: its road changes slowly")


@dataclass(frozen=True)
class Recording:
    """One or several recordings as columns: a row per frame, in the order of driving.

    Attributes:
        names: recordings' folders, as the user named them.
        recording: index in `names`, int64 [N].
        line: line in the log, int64 [N].
        images: center, left, right of each row, object [N, 3]: a path on this machine, a
            `StoredImage`, or None without an image.
        steering, throttle, brake: recorded values, float64 [N], -1..1 (right positive), -1..1,
            0..1.
        speed_mph: recorded speed, float64 [N].
        time_s: seconds since 1970, float64 [N]; NaN without a time.
        bad_images: a line on each row that was left out because of its image.
        bad_rows: a line on each row that `on_bad_row=skip` left out.
        places: file and row of each row, object [N]; None for lines of a `driving_log.csv`.
        rig: cameras and steering of the car; None if they are unknown, or differ.
        notes: a line on what was inferred, and on what else was left out.
        rigs: rig of each of `names`, where there are several.
        blocks: blocks of a split by time, as the format states.
        units: what the numbers of each of `names` mean; None as `data.steering` says, or -1..1.
        format: name of the format that was read, of several recordings that of the first.
    """

    names: tuple[str, ...]
    recording: np.ndarray
    line: np.ndarray
    images: np.ndarray
    steering: np.ndarray
    throttle: np.ndarray
    brake: np.ndarray
    speed_mph: np.ndarray
    time_s: np.ndarray
    bad_images: tuple[str, ...] = ()
    bad_rows: tuple[str, ...] = ()
    places: np.ndarray | None = None
    rig: Rig | None = None
    notes: tuple[str, ...] = ()
    rigs: tuple[Rig | None, ...] = ()
    blocks: Blocks = SHORT_DRIVES
    units: tuple[SteeringUnit | None, ...] = ()
    format: str = ""

    def __len__(self) -> int:
        return len(self.steering)

    @property
    def columns(self) -> dict[str, Any]:
        """Return the fields with a value for each row, arrays of the same length."""
        return {name: value for name, value in vars(self).items() if isinstance(value, np.ndarray)}

    @property
    def each_rig(self) -> tuple[Rig | None, ...]:
        """Return the rig of each of `names`."""
        return self.rigs or (self.rig,) * len(self.names)

    @property
    def without_rig(self) -> list[str]:
        """Return those of `names` whose rig is unknown."""
        return [name for name, rig in zip(self.names, self.each_rig, strict=True) if rig is None]

    @property
    def recordings(self) -> list["Recording"]:
        """Return the rows of each of `names`."""
        return [self.keep(self.recording == number) for number in range(len(self.names))]

    @property
    def without_speed(self) -> list[str]:
        """Return the names of the recordings whose speed is 0 in each row."""
        moving = set(self.recording[self.speed_mph != 0].tolist())
        return [name for number, name in enumerate(self.names) if number not in moving]

    @property
    def known_speed_mph(self) -> np.ndarray:
        """Return the speed; NaN in the recordings `without_speed`, which may lack the column."""
        moving = self.recording[self.speed_mph != 0]
        return np.where(np.isin(self.recording, moving), self.speed_mph, np.nan)

    def keep(self, mask: np.ndarray, bad_images: tuple[str, ...] = ()) -> "Recording":
        """Return the rows of `mask` (bool [N]); add `bad_images` to the skipped ones."""
        columns = {name: column[mask] for name, column in self.columns.items()}
        return replace(self, **columns, bad_images=self.bad_images + bad_images)

    def stored(self, row: int, camera: int) -> Stored:
        """Return an image as it is stored: bytes of a JPEG or PNG, or pixels of a video.

        Raises:
            OSError, ValueError: the image cannot be read.
        """
        return read_stored(self.images[row, camera])

    def image(self, row: int, camera: int = 0) -> np.ndarray:
        """Return an image in its own size, uint8 [H, W, 3] RGB; see `stored`."""
        return read_image(self.images[row, camera])

    def frame_size(self) -> tuple[int, int] | None:
        """Return height and width of the first centre image that can be read; None without one."""
        for image in filter(None, self.images[:, 0]):
            with suppress(OSError, ValueError):
                height, width, _ = read_image(image).shape
                return height, width
        return None

    def place(self, row: int) -> str:
        """Return a row's place, for messages: `FOLDER/driving_log.csv, row 7`."""
        if self.places is not None:
            return str(self.places[row])
        return f"{Path(self.names[self.recording[row]]) / LOG_NAME}, row {self.line[row]}"

    def fingerprint(self) -> str:
        """Return 16 hex digits of labels and image names, the same wherever the folder is.

        The labels are rounded: the expert's zeros are 1e-16 with other digits on another processor.
        """
        digest = hashlib.sha256()
        for name in (*LABELS, "recording"):
            digest.update(self._rounded(name).tobytes())
        names = (os.path.basename(str(path)) if path else "" for path in self.images.flat)  # noqa: PTH119
        digest.update("\n".join(names).encode())
        return digest.hexdigest()[:16]

    def row_hashes(self) -> list[int]:
        """Return the sorted hashes, 48 bits, of the distinct steering, throttle, brake and speed.

        They are the same in a copy with other images or names of images, or in another order.
        """
        rows = np.unique(np.stack([self._rounded(name) for name in LABELS], 1), axis=0)
        digests = (hashlib.sha256(row.tobytes()).digest() for row in rows)
        return sorted(int.from_bytes(digest[:6], "big") for digest in digests)

    def _rounded(self, name: str) -> np.ndarray:
        """Return a contiguous column of a hash, without negative zeros."""
        return np.ascontiguousarray(np.round(getattr(self, name), LABEL_DECIMALS) + 0)


def keep_valid(recording: Recording, bad: BadRows) -> Recording:
    """Return the rows whose numbers a log may have; note the others in `bad_rows`.

    Args:
        recording: rows as another program wrote them.
        bad: collector of rows that cannot be used, also of those that could not be read at all.

    Raises:
        InputError: a row is bad and not to be skipped, or none is left.
    """
    numbers, time_s = np.stack([getattr(recording, name) for name in LABELS], 1), recording.time_s
    low, high = np.array([RANGES[name] for name in NUMBERS]).T
    within = ((numbers >= low - ROUNDING) & (numbers <= high + ROUNDING)).all(1)
    good = within & (np.isnan(time_s) | ((time_s >= 0) & (time_s < LAST_S)))
    for row in np.flatnonzero(~good).tolist():
        time = f"the time {time_s[row]:g} s is not between 1970 and 9999"
        bad.faults.append(f"{recording.place(row)}: {range_fault(numbers[row]) or time}")
    steering, turns = set(numbers[~good, 0].tolist()), bool(numbers[good, 0].any())
    bad.finish(int(good.sum()), unit_hint(steering, turns))
    return replace(
        recording.keep(good),
        bad_rows=(*recording.bad_rows, *bad.faults),
        notes=(*recording.notes, *bad.notes),
    )


def make_recording(
    folder: Path, numbers: dict[str, np.ndarray], images: Mapping[str, Sequence], **others: Any
) -> Recording:
    """Return the recording of one folder.

    Args:
        folder: folder of the recording.
        numbers: steering, throttle, brake, speed_mph and time_s; of those that are missing, the
            time is unknown, and the others are 0 in each row.
        images: each camera's images, see `Recording.images`.
        others: other fields of `Recording`.
    """
    rows = len(numbers["steering"])
    stored = np.full((rows, len(CAMERAS)), None, object)
    for camera, column in images.items():
        stored[:, CAMERAS.index(camera)] = column
    columns: dict[str, Any] = {name: np.zeros(rows) for name in ("throttle", "brake", "speed_mph")}
    columns |= {"time_s": np.full(rows, np.nan), **numbers}
    fields = {"recording": np.zeros(rows, np.int64), "line": np.arange(1, rows + 1), **others}
    return Recording(names=(str(folder),), images=stored, **columns, **fields)


def indices(numbers: np.ndarray) -> np.ndarray:
    """Return numbers of a file as indices, int64; -1 for a number that is none.

    >>> indices(np.array([2.0, np.nan, -7.0, 1e300])).tolist()
    [2, -1, -1, -1]
    """
    return np.where((numbers >= 0) & (numbers < MOST_INDEX), numbers, -1).astype(np.int64)


def file_name(written: str) -> str:
    r"""Return the last part of a path of any system.

    >>> file_name(r"C:\Users\me\IMG\center_1.jpg"), file_name(" IMG/left_1.jpg")
    ('center_1.jpg', 'left_1.jpg')
    """
    return written[max(written.rfind("/"), written.rfind("\\")) + 1 :].strip()


def list_files(folder: str) -> dict[str, str]:
    """Return the path of each regular file in a folder, by its name; none of a missing folder."""
    try:
        # Opening a pipe would wait for its writer.
        with os.scandir(folder) as entries:
            return {entry.name: entry.path for entry in entries if entry.is_file()}
    except OSError:
        return {}


def fold(name: str) -> str:
    r"""Return a file's name without differences of case and of Unicode's form.

    >>> fold("A\u0308.JPG") == fold("\u00e4.jpg")
    True
    """
    return unicodedata.normalize("NFC", name).casefold()


def spellings(files: Mapping[str, str]) -> dict[str, str]:
    """Return the paths of `list_files` by folded names."""
    return {fold(name): files[name] for name in sorted(files)}


def unnamed_note(folders: Iterable[str], images: np.ndarray, left_out: int) -> list[str]:
    """Return a note on image files that no row names, or none.

    Args:
        folders: folders of the centre camera's images.
        images: images of each row, object [N, 3].
        left_out: number of images that other rows name, which are left out.
    """
    named, where, unnamed = set(images.flat), sorted(folders), -left_out
    for folder in where:
        with os.scandir(folder) as entries:
            files = (entry for entry in entries if entry.path not in named)
            unnamed += sum(1 for file in files if IMAGE.search(file.name))
    others = f" and {len(where) - 1} folders" if len(where) > 1 else ""
    return [f"{unnamed:,} images in {where[0]}{others} have no row"] if unnamed > 0 else []

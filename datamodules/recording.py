"""Recordings: the rows of a drive and their images, in any format that a reader is found for.

A format is a module with `title`, `detect` and `read` (see `Format`). drivezoo's own are in
`datamodules.formats`; an installed package names others by the entry point `drivezoo.formats`.
"""

import hashlib
import importlib
import itertools
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from datamodules.driving_log import CAMERAS, NUMBERS, RANGES, BadRows, degrees_hint, range_fault
from datamodules.image import Stored, decode_pixels, read_stored
from datamodules.read_options import ReadOptions
from datamodules.rig_file import find_rig, read_rig
from zoo.base.bounded_files import read_json
from zoo.base.errors import InputError, UsageError
from zoo.base.nearest import hint
from zoo.base.rig import UDACITY, Rig

LOG_NAME, IMAGE_FOLDER = "driving_log.csv", "IMG"
SOURCE_NAME = "source.json"  # beside the log of a converted recording
GAP_S = 1.0  # a longer time between two rows is a gap in the recording
LAST_S = 253_402_300_800.0  # 10000-01-01: image names have four digits for the year
GROUP = "drivezoo.formats"  # entry points of installed packages
OWN = {
    name: f"datamodules.formats.{name}"
    for name in (
        "udacity",
        "lerobot",
        "donkeycar",
        "challenge2",
        "sullychen",
        "deeppicar",
        "named_images",
        "comma2016",
        "comma2k19",
        "table",
    )
}


class ForwardReader:
    """A reader of files whose contents can only be read in order; one file is open at a time.

    Args:
        contents: function from a file to its contents, in order.
    """

    def __init__(self, contents: Callable[[Path], Iterator[Stored]]) -> None:
        self._contents = contents
        self._file, self._next = "", 0

    def __call__(self, file: str, number: int) -> Stored:
        """Return what stands at a position of a file; going back begins the file again.

        Raises:
            ValueError: the file is shorter.
        """
        if file != self._file or number < self._next - 1:
            self._file, self._next, self._items = file, 0, self._contents(Path(file))
        for item in self._items if number >= self._next else ():
            self._last, self._next = item, self._next + 1
            if self._next > number:
                break
        if number >= self._next:
            raise ValueError(f"it has {self._next:,} images, and this is number {number + 1:,}")
        return self._last


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
        rig: cameras and steering of the car; None if they are unknown.
        notes: a line on what was inferred, and on what else was left out.
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
    rig: Rig | None = UDACITY
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.steering)

    @property
    def without_speed(self) -> list[str]:
        """Return the names of the recordings whose speed is 0 in each row."""
        moving = set(self.recording[self.speed_mph != 0].tolist())
        return [name for number, name in enumerate(self.names) if number not in moving]

    def keep(self, mask: np.ndarray, bad_images: tuple[str, ...] = ()) -> "Recording":
        """Return the rows of `mask` (bool [N]); add `bad_images` to the skipped ones."""
        columns = {name: one[mask] for name, one in vars(self).items() if _is_column(one)}
        return replace(self, **columns, bad_images=self.bad_images + bad_images)

    def stored(self, row: int, camera: int) -> Stored:
        """Return an image as it is stored: bytes of a JPEG or PNG, or pixels of a video.

        Raises:
            OSError, ValueError: the image cannot be read.
        """
        return read_stored(self.images[row, camera])

    def image(self, row: int, camera: int = 0) -> np.ndarray:
        """Return an image in its own size, uint8 [H, W, 3] RGB; see `stored`."""
        stored = self.stored(row, camera)
        return decode_pixels(stored) if isinstance(stored, bytes) else stored

    def place(self, row: int) -> str:
        """Return a row's place, for messages: `FOLDER/driving_log.csv, row 7`."""
        if self.places is not None:
            return str(self.places[row])
        log = Path(self.names[self.recording[row]]) / LOG_NAME
        return f"{log}, row {self.line[row]}"

    def fingerprint(self) -> str:
        """Return 16 hex digits of labels and image names, the same wherever the folder is."""
        digest = hashlib.sha256()
        for name in ("steering", "throttle", "brake", "speed_mph", "recording"):
            digest.update(np.ascontiguousarray(getattr(self, name)).tobytes())
        names = (os.path.basename(str(path)) if path else "" for path in self.images.flat)  # noqa: PTH119
        digest.update("\n".join(names).encode())
        return digest.hexdigest()[:16]


class Format(Protocol):
    """One way to store recordings: a module, or an object, with these names.

    Attributes:
        title: the format in words, such as `Donkeycar tub`.
    """

    title: str

    def detect(self, path: Path) -> bool:
        """Return whether a folder or file has this format, by the names of its files."""

    def read(self, path: Path, options: ReadOptions) -> Recording:
        """Return the recording in a folder or file.

        Raises:
            InputError: a file is missing or damaged, or no row is left.
        """


def formats() -> Iterator[tuple[str, Format]]:
    """Yield the name and the reader of each format, those of installed packages last."""
    for name, module in OWN.items():
        yield name, importlib.import_module(module)
    from importlib.metadata import entry_points  # slow import

    for point in entry_points(group=GROUP):
        if point.name in OWN:
            continue
        try:
            yield point.name, point.load()
        except Exception as error:
            raise InputError(
                f"{point.value}: the format {point.name} cannot be imported ({error}); install "
                "its package again"
            ) from None


def known_format(path: Path, name: str | None = None) -> tuple[str, Format] | None:
    """Return the format of a folder or file and its name, None if it has none of them.

    Args:
        path: folder or file.
        name: name of the format; None finds it.

    Raises:
        InputError: it has several formats.
        UsageError: there is no format of this name.
    """
    known = formats()
    if name is not None:
        named = dict(known)
        if name not in named:
            raise UsageError(f"format={name}: no such format; {hint(name, named)}")
        return name, named[name]
    fitting = [pair for pair in itertools.islice(known, len(OWN)) if pair[1].detect(path)]
    # A package that cannot be imported does not matter to our own formats.
    fitting = fitting or [pair for pair in known if pair[1].detect(path)]
    if len(fitting) > 1:
        titles = ", ".join(f"{one} ({fits.title})" for one, fits in fitting)
        raise InputError(f"{path}: has the files of several formats, {titles}; name one: format=")
    return fitting[0] if fitting else None


def find_format(path: Path, name: str | None = None) -> tuple[str, Format]:
    """Return the format of the recording in a folder or file, and its name.

    Raises:
        InputError: there is no such folder, or it has none of the formats, or several.
        UsageError: there is no format of this name.
    """
    if named := known_format(path, name):
        return named
    raise InputError(importlib.import_module(OWN["udacity"]).missing(path))


def read_recording(path: Path, options: ReadOptions) -> tuple[str, Recording]:
    """Return the format of a recording and its rows, with the car's rig of the user's file.

    Raises:
        InputError, UsageError: see `find_format` and `Format.read`; or the rig's file is wrong.
    """
    name, source = find_format(path, options.format)
    recording = source.read(path, options)
    folder = path.parent if path.is_file() else path
    rig = read_rig(Path(options.rig).expanduser()) if options.rig else find_rig(folder)
    return name, replace(recording, rig=rig) if rig else recording


def read_recordings(roots: str | Sequence[str], **said: Any) -> Recording:
    """Read one folder, or several as one `Recording`, in any of the formats.

    Args:
        roots: folders or files of recordings.
        **said: fields of `ReadOptions`.

    Raises:
        InputError: a folder, log, row or image is missing or wrong.
        UsageError: a format or what the user says of it does not exist.
    """
    roots = [roots] if isinstance(roots, str) else list(roots)
    if not roots:
        raise InputError("data.root is an empty list: name the folder of a recording")
    options = ReadOptions(**said)
    parts = [_read_readable(Path(root).expanduser(), options) for root in roots]
    if any(part.places is not None for part in parts) and len(parts) > 1:
        parts = [replace(part, places=_places(part)) for part in parts]
    columns = [name for name, one in vars(parts[0]).items() if _is_column(one)]
    joined: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in parts]) for name in columns
    }
    joined["recording"] = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    rigs = [part.rig for part in parts]
    whole = Recording(
        names=tuple(part.names[0] for part in parts),
        bad_images=tuple(line for part in parts for line in part.bad_images),
        bad_rows=tuple(line for part in parts for line in part.bad_rows),
        rig=rigs[0] if rigs.count(rigs[0]) == len(rigs) else None,
        notes=tuple(f"{part.names[0]}: {note}" for part in parts for note in part.notes),
        **joined,
    )
    if not len(whole):
        raise InputError(
            f"{', '.join(whole.names)}: no rows left, all {len(whole.bad_images)} have a bad image "
            f"({whole.bad_images[0]}); copy the images, or set data.images=FOLDER"
        )
    return whole


def _places(recording: Recording) -> np.ndarray:
    return np.array([recording.place(row) for row in range(len(recording))], object)


def _read_readable(root: Path, options: ReadOptions) -> Recording:
    try:
        return read_recording(root, options)[1]
    except OSError as error:
        raise InputError(
            f"{error.filename or root}: {error.strerror}; allow your user to read it, or name "
            "another folder"
        ) from None


def keep_valid(recording: Recording, bad: BadRows) -> Recording:
    """Return the rows whose numbers a log may have; note the others in `bad_rows`.

    Args:
        recording: rows as another program wrote them.
        bad: collector of rows that cannot be used, also of those that could not be read at all.

    Raises:
        InputError: a row is bad and not to be skipped, or none is left.
    """
    columns = (recording.steering, recording.throttle, recording.brake, recording.speed_mph)
    numbers, time_s = np.stack(columns, axis=1), recording.time_s
    low, high = np.array([RANGES[name] for name in NUMBERS]).T
    within = ((numbers >= low) & (numbers <= high)).all(1)
    good = within & (np.isnan(time_s) | ((time_s >= 0) & (time_s < LAST_S)))
    for row in np.flatnonzero(~good).tolist():
        time = f"the time {time_s[row]:g} s is not between 1970 and 9999"
        bad.faults.append(f"{recording.place(row)}: {range_fault(numbers[row]) or time}")
    largest = np.abs(numbers[:, 0]).max(initial=0, where=np.isfinite(numbers[:, 0]))
    bad.finish(int(good.sum()), degrees_hint(largest))
    return replace(recording.keep(good), bad_rows=(*recording.bad_rows, *bad.faults))


def make_recording(
    folder: Path, numbers: dict[str, np.ndarray], images: Mapping[str, Sequence], **more: Any
) -> Recording:
    """Return the recording of one folder.

    Args:
        folder: folder of the recording.
        numbers: steering, throttle, brake, speed_mph and time_s; of those that are missing, the
            time is unknown, and the others are 0 in each row.
        images: each camera's images, see `Recording.images`.
        more: other fields of `Recording`.
    """
    rows = len(numbers["steering"])
    stored = np.full((rows, len(CAMERAS)), None, object)
    for camera, column in images.items():
        stored[:, CAMERAS.index(camera)] = column
    columns: dict[str, Any] = {name: np.zeros(rows) for name in ("throttle", "brake", "speed_mph")}
    columns |= {"time_s": np.full(rows, np.nan), **numbers}
    fields = {"recording": np.zeros(rows, np.int64), "line": np.arange(1, rows + 1), **more}
    return Recording(names=(str(folder),), images=stored, **columns, **fields)


def write_source(folder: Path, source: str) -> None:
    """Write which format a recording was converted from: its cameras and car are of that rig."""
    (folder / SOURCE_NAME).write_text(f'{{"version": 1, "format": "{source}"}}\n', encoding="utf-8")


def read_source(folders: Iterable[str | Path]) -> str | None:
    """Return the format that one of the recordings was converted from; None for Udacity's rig.

    Raises:
        InputError: the file that names the format is damaged.
    """
    for folder in folders:
        path = Path(folder) / SOURCE_NAME
        if path.is_file():
            found = read_json(path)
            source = found.get("format") if isinstance(found, dict) else None
            if not isinstance(source, str) or not re.fullmatch(r"[\w.-]{1,80}", source):
                raise InputError(f"{path}: format: must be the name of a format, such as lerobot")
            return source
    return None


def other_car(recording: Recording) -> str | None:
    """Return the name of the car or format of a recording; None if it is Udacity's car.

    Raises:
        InputError: see `read_source`.
    """
    if source := read_source(recording.names):
        return source
    if recording.rig == UDACITY:
        return None
    return recording.rig.name if recording.rig else "a car of unknown make"


def file_name(written: str) -> str:
    r"""Return the last part of a path of any system.

    >>> file_name(r"C:\Users\me\IMG\center_1.jpg"), file_name(" IMG/left_1.jpg")
    ('center_1.jpg', 'left_1.jpg')
    """
    return written[max(written.rfind("/"), written.rfind("\\")) + 1 :].strip()


def _is_column(value: object) -> bool:
    return isinstance(value, np.ndarray)

"""comma.ai's dataset of 2016: `camera/NAME.h5` with images and `log/NAME.h5` with numbers.

https://github.com/commaai/research, Logs.md: images uint8 [N, 3, 160, 320] at 20 Hz; a log of 100
Hz with `steering_angle` (degrees of the wheel of an Acura ILX of 2016), `speed` (m/s) and
`cam1_ptr`, the image of each row. The sign is not stated.
"""

import math
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from datamodules.format_options import ReadOptions
from datamodules.formats.labels import Rows, labelled_recording
from datamodules.image import ForwardReader, StoredImage
from datamodules.recording import LONG_DRIVE, Recording, indices
from datamodules.steering_unit import SteeringUnit
from zoo.base.bounded_files import open_data
from zoo.base.errors import InputError, library_errors, optional_import
from zoo.base.limits import MOST
from zoo.base.rig import Camera, single_camera_rig

title = "recording of comma.ai (2016)"
UNIT = SteeringUnit("deg", full=500.0, right="negative")
# Wheelbase and ratio: openpilot's values of the Acura ILX (18.61).
RIG = single_camera_rig(
    "Acura ILX of 2016",
    Camera(0.0, 1.3, 0.4, size=(320, 160), vertical_fov_deg=45.0),
    wheelbase_m=2.67,
    steering_deg=UNIT.full / 18.61,
    guesses=("camera", "full"),
)
MOST_BYTES = 64_000_000_000
MOST_VALUES, MOST_CHUNK = 10 * MOST["rows"], 100_000_000
SHAPE = (3, 160, 320)
DAMAGED, REMEDY = "no whole HDF5 file", "download it again"


def detect(path: Path) -> bool:
    """Return whether a folder holds a camera's file and its log."""
    return any((path / "log" / camera.name).is_file() for camera in (path / "camera").glob("*.h5"))


def read(path: Path, options: ReadOptions) -> Recording:
    """Return a row for each image that the logs name.

    Raises:
        InputError: h5py is missing, a file is damaged, or the images do not settle the sign.
    """
    rows: Rows = defaultdict(list)
    reader, notes = ForwardReader(_images), []
    for camera in sorted((path / "camera").glob("*.h5")):
        log = path / "log" / camera.name
        pointer, degrees, speed, time_s = _log(log)
        # The first row of the log in which an image is the last one.
        images, first = np.unique(pointer, return_index=True)
        images, first = images[images >= 0], first[images >= 0]
        rows["place"] += [f"{log}, row {row + 1}" for row in first.tolist()]
        rows["center"] += [StoredImage(str(camera), row, reader) for row in images.tolist()]
        with _open(camera) as file, library_errors(camera, DAMAGED, REMEDY):
            count = len(_dataset(file, camera, "X", 4))
        unnamed = count - len(images)
        notes += [f"{unnamed:,} of {count:,} images in {camera} have no row"] * (unnamed > 0)
        for name, column in (("steering", degrees), ("speed_mps", speed), ("time_s", time_s)):
            rows[name] += column[first].tolist()
    about: dict[str, Any] = {"rig": RIG, "notes": tuple(notes), "blocks": LONG_DRIVE}
    return labelled_recording(path, rows, UNIT, options, is_stated=False, **about)


def _log(path: Path) -> tuple[np.ndarray, ...]:
    """Return the columns of a log: image of each row, degrees, m/s, seconds."""
    with _open(path) as file, library_errors(path, DAMAGED, REMEDY):
        names = ("cam1_ptr", "steering_angle", "speed", "times")
        pointer, *numbers = (_dataset(file, path, name, 1)[:] for name in names)
    if len({len(column) for column in (pointer, *numbers)}) > 1:
        raise InputError(f"{path}: its columns differ in length; {REMEDY}")
    return indices(pointer), *numbers


def _images(path: Path) -> Iterator[np.ndarray]:
    """Yield the images of a file, uint8 [H, W, 3] RGB."""
    with _open(path) as file:
        with library_errors(path, DAMAGED, REMEDY):
            images = _dataset(file, path, "X", 4)
            if images.dtype != np.uint8 or images.shape[1:] != SHAPE:
                raise InputError(f"{path}: X is not uint8 [N, 3, 160, 320]; {REMEDY}")
        for number in range(len(images)):
            try:
                yield np.ascontiguousarray(images[number].transpose(1, 2, 0))
            except (OSError, RuntimeError) as error:
                raise ValueError(f"{path}: image {number + 1} is damaged ({error})") from None


def _open(path: Path) -> Any:
    with optional_import(f"{path}: needs h5py; install drivezoo[keras]"):
        import h5py
    with library_errors(path, DAMAGED, REMEDY):
        return h5py.File(open_data(path, MOST_BYTES), "r")


def _dataset(file: Any, path: Path, name: str, dimensions: int) -> Any:
    """Return a dataset of numbers, which no link leads to another file for."""
    import h5py

    data: Any = file[name] if isinstance(file.get(name, getlink=True), h5py.HardLink) else None
    fits = isinstance(data, h5py.Dataset) and data.ndim == dimensions and data.dtype.kind in "uif"
    if not fits or data.external or data.is_virtual:
        raise InputError(f"{path}: {name} is no array of numbers in the file; {REMEDY}")
    # A few bytes can claim any number of equal values.
    most = MOST_VALUES if dimensions == 1 else MOST["rows"]
    if len(data) > most or math.prod(data.chunks or ()) * data.dtype.itemsize > MOST_CHUNK:
        raise InputError(
            f"{path}: {name} claims {len(data):,} rows in pieces of {data.chunks}, more than the "
            f"{most:,} rows and {MOST_CHUNK:,} bytes a piece that are read; divide the recording"
        )
    return data

"""Segments of comma2k19: `processed_log/CAN/steering_angle/{t,value}` beside `video.hevc`.

https://github.com/commaai/comma2k19: degrees of the wheel, m/s, seconds since the start of the
phone; `global_pose/frame_times` has the time of each frame. The sign is not stated.
"""

from pathlib import Path

import numpy as np

from datamodules.format_options import ReadOptions
from datamodules.formats.labels import labelled_recording
from datamodules.recording import LONG_DRIVE, Recording
from datamodules.steering_unit import SteeringUnit
from zoo.base.bounded_files import open_data
from zoo.base.errors import InputError, library_errors
from zoo.base.limits import MOST
from zoo.base.rig import Camera, single_camera_rig
from zoo.extras.formats.video_frames import video_images

title = "segment of comma2k19"
UNIT = SteeringUnit("deg", full=500.0, right="negative")
# One of two cars, a Toyota RAV4 and a Honda Civic; the numbers are openpilot's of the RAV4.
RIG = single_camera_rig(
    "car of comma2k19",
    Camera(0.0, 1.2, 0.4, size=(1164, 874), vertical_fov_deg=51.3),
    wheelbase_m=2.65,
    steering_deg=UNIT.full / 16.88,
    guesses=("which of two cars", "place of the camera", "full"),
)
VIDEO, TIMES = "video.hevc", "global_pose/frame_times"
STEERING, SPEED = "processed_log/CAN/steering_angle", "processed_log/CAN/speed"
MOST_BYTES = 8 * 10 * MOST["rows"]


def detect(path: Path) -> bool:
    """Return whether a folder is a segment, also one without its video."""
    return (path / STEERING / "value").is_file()


def read(path: Path, options: ReadOptions) -> Recording:
    """Return a row for each frame, with the steering and the speed at its time.

    Raises:
        InputError: a file is damaged, or the images do not settle the sign.
    """
    times = _array(path / TIMES)
    image = video_images(path / VIDEO)
    rows = {
        "place": [f"{path / VIDEO}, frame {number}" for number in range(1, len(times) + 1)],
        "center": [image(number) for number in range(len(times))],
        "time_s": times.tolist(),
        "steering": _at(times, path / STEERING).tolist(),
        "speed_mps": _at(times, path / SPEED).tolist(),
    }
    return labelled_recording(
        path, rows, UNIT, options, is_stated=False, rig=RIG, blocks=LONG_DRIVE
    )


def _at(times: np.ndarray, folder: Path) -> np.ndarray:
    """Return a signal at some times, linear between its samples."""
    at, value = _array(folder / "t"), _array(folder / "value")
    if len(at) != len(value) or not len(at) or (np.diff(at) < 0).any():
        raise InputError(f"{folder}: t and value are no signal in time; download it again")
    return np.interp(times, at, value)


def _array(path: Path) -> np.ndarray:
    """Return the numbers in a file of NumPy, float64 [N]."""
    with library_errors(path, "no array of numbers", "download it again"):
        with open_data(path, MOST_BYTES) as file:
            numbers = np.load(file, allow_pickle=False)
        return numbers.astype(np.float64).reshape(len(numbers))

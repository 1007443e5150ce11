"""Udacity's Challenge 2: `interpolated.csv` or `CH2_final_evaluation.csv` with camera images.

https://github.com/udacity/self-driving-car, challenges/challenge-2: radians of the steering wheel
of a Lincoln MKZ, positive to the left; 20 frames a second, m/s. The wheel turns 14.8 times as far
as the front wheels. https://github.com/rwightman/udacity-driving-reader writes the training layout.
"""

import math
from pathlib import Path
from typing import Any

import numpy as np

from datamodules.driving_log import CAMERAS, BadRows
from datamodules.format_options import ReadOptions
from datamodules.formats.labels import Rows, collect, decimal, inside, labelled_recording, read_csv
from datamodules.recording import LONG_DRIVE, Recording
from datamodules.steering_unit import SteeringUnit
from zoo.base.rig import Camera, single_camera_rig

title = "recording of Udacity's Challenge 2"
TRAINING, TEST = "interpolated.csv", "CH2_final_evaluation.csv"
UNIT = SteeringUnit("rad", full=8.2, right="negative")  # 470 degrees of the wheel
# The wheel's ratio: shared by the challenge's teams. The wheelbase: Lincoln's data of 2016.
RIG = single_camera_rig(
    "Lincoln MKZ of Challenge 2",
    Camera(0.0, 1.4, 0.4, size=(640, 480), vertical_fov_deg=45.0),
    wheelbase_m=2.85,
    steering_deg=math.degrees(UNIT.full) / 14.8,
    guesses=("camera", "full"),
)
SAME_MOMENT_S = 0.05  # the cameras are not triggered together


def detect(path: Path) -> bool:
    """Return whether a folder holds one of the two tables."""
    return (path / TRAINING).is_file() or (path / TEST).is_file()


def read(path: Path, options: ReadOptions) -> Recording:
    """Return a row for each frame of the centre camera, with the side cameras' nearest frames.

    Raises:
        InputError: a row or an image is bad, or the numbers are not a wheel's radians.
    """
    bad = BadRows(options.on_bad_row)
    rows = _training(path, bad) if (path / TRAINING).is_file() else _test(path, bad)
    return labelled_recording(path, rows, UNIT, options, bad, rig=RIG, blocks=LONG_DRIVE)


def _test(path: Path, bad: BadRows) -> Rows:
    def parse(fields: dict[str, str]) -> dict[str, Any]:
        return {
            "steering": decimal(fields, "steering_angle"),
            "time_s": decimal(fields, "frame_id") / 1e9,
            "center": inside(path, f"center/{fields['frame_id']}.jpg"),
        }

    return collect(read_csv(path / TEST, ("frame_id", "steering_angle"), bad), parse, bad)


def _training(path: Path, bad: BadRows) -> Rows:
    folder = path / "images" if (path / "images").is_dir() else path

    def parse(fields: dict[str, str]) -> dict[str, Any]:
        return {
            "camera": fields["frame_id"].removesuffix("_camera"),
            "steering": decimal(fields, "angle"),
            "time_s": decimal(fields, "timestamp") / 1e9,
            "speed_mps": decimal(fields, "speed"),
            "center": inside(folder, fields["filename"]),
        }

    columns = ("timestamp", "frame_id", "filename", "angle", "speed")
    table = collect(read_csv(path / TRAINING, columns, bad), parse, bad)
    # Other recorders of this layout have one camera, under a name of their own.
    del table["line"]  # its rows are of several cameras, in no fixed order
    camera = np.array([name if name in CAMERAS else "center" for name in table.pop("camera", [])])
    rows = {name: np.array(column, object)[camera == "center"] for name, column in table.items()}
    times, images = np.array(table.get("time_s", []), float), np.array(table["center"], object)
    for side in CAMERAS[1:]:
        of_side = camera == side
        if of_side.any():
            rows[side] = _nearest(rows["time_s"].astype(float), times[of_side], images[of_side])
    return {name: list(column) for name, column in rows.items()}


def _nearest(moments: np.ndarray, times: np.ndarray, images: np.ndarray) -> np.ndarray:
    """Return the image, object [N], of the time nearest to each moment; None if none is near."""
    order = np.argsort(times)
    after = np.searchsorted(times[order], moments)
    pair = order[np.clip(np.stack([after - 1, after]), 0, len(times) - 1)]
    nearest = pair[np.abs(times[pair] - moments).argmin(0), np.arange(len(moments))]
    chosen = images[nearest]
    chosen[np.abs(times[nearest] - moments) > SAME_MOMENT_S] = None
    return chosen

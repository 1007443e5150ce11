"""Recordings of a DeepPicar: `out-video.avi` and `out-key.csv`.

https://github.com/mbechtel2/DeepPicar-v3, deeppicar.py: radians of the front wheels, 30 degrees at
full lock, positive to the right; frames are counted from 1. https://github.com/heechul/
DeepPicar-ESP32S3 calls the time `ts`, and has forks with a `throttle`, 0..1 or in percent.
"""

import math
from pathlib import Path
from typing import Any

from datamodules.driving_log import BadRows, read_fields
from datamodules.format_options import ReadOptions
from datamodules.formats.labels import collect, decimal, labelled_recording, read_csv
from datamodules.recording import Recording
from datamodules.steering_unit import SteeringUnit
from datamodules.stretches import in_seconds
from zoo.base.rig import Camera, single_camera_rig
from zoo.extras.formats.video_frames import video_images

title = "DeepPicar recording"
KEYS, VIDEO = "out-key.csv", "out-video.avi"
UNIT = SteeringUnit("rad", full=math.radians(30))

RIG = single_camera_rig(
    "DeepPicar",
    Camera(0.0, 0.15, 0.1, size=(320, 240), vertical_fov_deg=45.0),
    wheelbase_m=0.14,
    steering_deg=30.0,
    guesses=("camera", "wheelbase"),
)


def detect(path: Path) -> bool:
    """Return whether a folder holds the file of keys and the video."""
    return (path / KEYS).is_file() and (path / VIDEO).is_file()


def read(path: Path, options: ReadOptions) -> Recording:
    """Return the rows of the file of keys, each with its frame of the video.

    Raises:
        InputError: a row is bad, or the steering is not in radians of the wheels.
    """
    image = video_images(path / VIDEO)
    header = next((fields for _, fields in read_fields(path / KEYS, BadRows())), [])
    clock = "ts" if "ts" in header else "ts_micro"

    def parse(fields: dict[str, str]) -> dict[str, Any]:
        frame = decimal(fields, "frame")
        if frame < 1 or frame % 1:
            raise ValueError(f"frame is {fields['frame']:.20}, not a number from 1")
        throttle = {"throttle": decimal(fields, "throttle")} if "throttle" in fields else {}
        return throttle | {
            "steering": decimal(fields, "wheel"),
            "time_s": decimal(fields, clock),  # mostly milliseconds, also those of `ts_micro`
            "center": image(int(frame) - 1),
        }

    bad = BadRows(options.on_bad_row)
    rows = collect(read_csv(path / KEYS, (clock, "frame", "wheel"), bad), parse, bad)
    rows["time_s"] = in_seconds(rows.get("time_s", []), most=1e6)
    if max(map(abs, rows.get("throttle", [])), default=0) > 1:
        rows["throttle"] = [percent / 100 for percent in rows["throttle"]]
    return labelled_recording(path, rows, UNIT, options, bad, rig=RIG)

"""The layout of SullyChen's dataset: `data.txt` with an image and degrees of the wheel a line.

https://github.com/SullyChen/driving-datasets: `0.jpg -1.23` or `0.jpg -1.23,2018-07-01
17:09:44:912`. The wheel's degrees are those of a Honda Civic of 2014; toy cars use the same layout
for a servo's numbers, which is why the images must agree.
"""

import re
from collections.abc import Iterator
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import Any

from datamodules.driving_log import MOST_LOG_BYTES, BadRows
from datamodules.format_options import ReadOptions
from datamodules.formats.labels import collect, inside, labelled_recording
from datamodules.recording import LONG_DRIVE, Recording
from datamodules.steering_unit import SteeringUnit
from zoo.base.bounded_files import open_text
from zoo.base.errors import InputError
from zoo.base.rig import Camera, single_camera_rig

title = "folder in SullyChen's layout"
LOG = "data.txt"
UNIT = SteeringUnit("deg", full=540.0)  # of the wheel; one and a half turns to full lock
RIG = single_camera_rig(
    "Honda Civic of 2014",
    Camera(0.0, 1.3, 0.4, size=(455, 256), vertical_fov_deg=45.0),
    wheelbase_m=2.67,
    steering_deg=UNIT.full / 16,
    guesses=("camera", "full", "ratio of the steering wheel", "wheelbase"),
)
_ROW = re.compile(r"(\S.*\.(?:jpe?g|png)) (-?[\d.]+(?:e-?\d+)?)(?:,(\S+ \S+))?", re.IGNORECASE)


def detect(path: Path) -> bool:
    """Return whether a folder holds a `data.txt` whose first row names an image."""
    if not (path / LOG).is_file():
        return False
    with suppress(InputError), open_text(path / LOG, MOST_LOG_BYTES, errors="replace") as file:
        return bool(_ROW.fullmatch(file.readline(1000).strip()))
    return False


def read(path: Path, options: ReadOptions) -> Recording:
    """Return the rows of `data.txt`.

    Raises:
        InputError: a row or an image is bad, or the images do not agree with the steering.
    """

    def parse(text: str) -> dict[str, Any]:
        if not (row := _ROW.fullmatch(text)):
            raise ValueError(f"{text!r:.80} is not IMAGE DEGREES[,DATE TIME]")
        image, degrees, moment = row.groups()
        return {"center": inside(path, image), "steering": float(degrees), "time_s": _time(moment)}

    bad = BadRows(options.on_bad_row)
    rows = collect(_lines(path / LOG), parse, bad)
    return labelled_recording(
        path, rows, UNIT, options, bad, is_stated=False, rig=RIG, blocks=LONG_DRIVE
    )


def _lines(log: Path) -> Iterator[tuple[str, str]]:
    colons = -1  # of the time in the row before
    with open_text(log, MOST_LOG_BYTES, errors="replace") as file:
        for line, text in enumerate(file, 1):
            is_whole = _ROW.fullmatch(text.strip()) and text.count(":") == colons
            if text.strip() and (text.endswith("\n") or is_whole):  # the last may be half written
                yield f"{log}, row {line}", text.strip()
            colons = text.count(":")


def _time(text: str | None) -> float:
    if text is None:
        return float("nan")
    # The release of 2018 writes 11 ms as `:11`, which strptime's %f takes for 110 ms.
    second, _, milliseconds = text.rpartition(":")
    moment = f"{second}:{milliseconds:0>3}+0000"
    return datetime.strptime(moment, "%Y-%m-%d %H:%M:%S:%f%z").timestamp()

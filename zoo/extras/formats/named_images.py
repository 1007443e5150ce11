"""Images whose names hold a point of the road ahead, as JetRacer and JetBot write them.

https://github.com/NVIDIA-AI-IOT/jetracer, notebooks/xy_dataset.py: `<x>_<y>_<uuid>.jpg`, pixels;
JetBot's road following: `xy_<x>_<y>_<uuid>.jpg`. The steering is the point's distance from the
middle, in halves of its own image's width, as both projects' networks learn it. There is no time.
"""

import re
from pathlib import Path

from datamodules.format_options import ReadOptions
from datamodules.formats.labels import labelled_recording
from datamodules.image import MOST_IMAGE_BYTES, image_size
from datamodules.recording import Recording
from datamodules.steering_unit import SteeringUnit
from zoo.base.bounded_files import open_binary
from zoo.base.errors import InputError

title = "folder of a JetRacer or JetBot"
NOTE = "the steering is the way to a point of the road ahead; the images have no times"
_NAME = re.compile(r"(?:xy_)?(\d{1,5})_(\d{1,5})_[0-9a-f]{8}[0-9a-f-]*\.jpe?g", re.IGNORECASE)


def detect(path: Path) -> bool:
    """Return whether a folder holds an image with such a name."""
    return path.is_dir() and any(
        _NAME.fullmatch(image.name) for image in path.glob("*_*_*.[jJ]*[gG]")
    )


def read(path: Path, options: ReadOptions) -> Recording:
    """Return the images in the order of their names.

    Raises:
        InputError: the first image is damaged, or the points are beyond its width.
    """
    pairs = [(image, _NAME.fullmatch(image.name)) for image in sorted(path.iterdir())]
    named = [(str(image), int(name[1])) for image, name in pairs if name]
    if not named:
        raise InputError(f"{path}: holds no image named X_Y_UUID.jpg; name another folder")
    widths: list[int] = []
    for image, _ in named:
        try:
            with open_binary(image, MOST_IMAGE_BYTES) as file:
                widths.append(image_size(file)[0])
        except (OSError, ValueError) as error:
            if not widths:
                raise InputError(f"{image}: {error}; copy it again, or delete it") from None
            widths.append(widths[0])  # of a row that is left out for its image
    images, columns = map(list, zip(*named, strict=True))
    points = [at * widths[0] / width for at, width in zip(columns, widths, strict=True)]
    rows = {"place": images, "center": images, "steering": points}
    half = widths[0] / 2
    unit = SteeringUnit("px", full=half, zero=half)
    return labelled_recording(path, rows, unit, options, notes=(NOTE,))

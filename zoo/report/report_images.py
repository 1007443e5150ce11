"""Pictures of a write-up: frames with their steering drawn in, and plots with photographs."""

import io
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from datamodules.image import read_image
from zoo.report.blocks import MissingError, Picture

SCALE = 2
AMBER, DARK = (240, 173, 74), (20, 24, 28)
QUALITY = 88


def read_frame(path: Path | str) -> np.ndarray:
    """A camera's picture, uint8 [H, W, 3] RGB; MissingError where it cannot be read."""
    try:
        return read_image(path)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise MissingError(f"{path}: {reason}.") from None


def labelled_frame(name: str, frame: np.ndarray, steering: float, caption: str) -> Picture:
    """A frame, twice as large, with an arrow to where `steering` (-1..1) points, as on the batch
    that was fed: full lock is 45 degrees."""
    large = cv2.resize(frame, None, fx=SCALE, fy=SCALE, interpolation=cv2.INTER_CUBIC)
    height, width = large.shape[:2]
    length, angle = 0.5 * height, steering * np.pi / 4
    foot = (width // 2, height - 1)
    tip = (
        round(width / 2 + length * np.sin(angle)),
        round(height - 1 - length * np.cos(angle)),
    )
    for colour, thickness in ((DARK, 9), (AMBER, 5)):  # seen on a light road and on a dark one
        cv2.arrowedLine(large, foot, tip, colour, thickness, cv2.LINE_AA, tipLength=0.12)
    return jpeg(f"{name}.jpg", large, caption)


def jpeg(name: str, picture: np.ndarray, caption: str) -> Picture:
    """uint8 [H, W, 3] RGB as a JPEG file's bytes."""
    file = io.BytesIO()
    Image.fromarray(picture).save(file, "JPEG", quality=QUALITY)
    return Picture(name, file.getvalue(), caption)


def smaller(picture: Picture) -> Picture:
    """A plot full of photographs as JPEG, a fifth of the PNG."""
    image = Image.open(io.BytesIO(picture.data)).convert("RGB")
    return jpeg(f"{Path(picture.name).stem}.jpg", np.asarray(image), picture.caption)

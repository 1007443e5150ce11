"""Images of a report: frames with an arrow for their steering, and smaller plots."""

import io
from pathlib import Path

import cv2
import numpy as np
import PIL.Image

from zoo.report.blocks import Image

WIDTH = 640  # of a frame
AMBER, DARK = (240, 173, 74), (20, 24, 28)
QUALITY = 88


def labelled_frame(name: str, frame: np.ndarray, steering: float, caption: str) -> Image:
    """Return an enlarged frame with an arrow for the steering (-1..1), its last word.

    Full lock is 45 degrees, as in the plot of the network's input.
    """
    width, height = WIDTH, WIDTH * len(frame) // frame.shape[1]
    large = cv2.resize(frame, (width, height), interpolation=cv2.INTER_CUBIC)
    length, angle = 0.5 * height, steering * np.pi / 4
    foot = (width // 2, height - 1)
    tip = round(width / 2 + length * np.sin(angle)), round(foot[1] - length * np.cos(angle))
    for colour, thickness in ((DARK, 9), (AMBER, 5)):  # visible on light and dark roads
        cv2.arrowedLine(large, foot, tip, colour, thickness, cv2.LINE_AA, tipLength=0.12)
    return jpeg(f"{name}.jpg", large, f"{caption} {signed(steering)}")


def signed(steering: float) -> str:
    """Return a steering as text, with its sign."""
    return f"{steering + 0.0:+.3f}"


def jpeg(name: str, pixels: np.ndarray, caption: str) -> Image:
    """Return a JPEG of pixels, uint8 [H, W, 3] RGB."""
    file = io.BytesIO()
    PIL.Image.fromarray(pixels).save(file, "JPEG", quality=QUALITY)
    return Image(name, file.getvalue(), caption)


def smaller(image: Image) -> Image:
    """Return a plot with many photographs as JPEG, a fifth of the PNG's size."""
    pixels = np.asarray(PIL.Image.open(io.BytesIO(image.data)).convert("RGB"))
    return jpeg(f"{Path(image.name).stem}.jpg", pixels, image.caption)

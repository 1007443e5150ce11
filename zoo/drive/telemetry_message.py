"""What a simulator sends, read; whatever it is."""

import base64
import binascii
import io
import math
import re
from dataclasses import dataclass

import cv2
import numpy as np
from PIL import Image

from datamodules.image import (
    FRAME_HEIGHT,
    FRAME_WIDTH,
    decode_image,
    find_scan_fault,
    jpeg_size,
)

NUMBERS = ("steering_angle", "throttle", "speed")
# Limits before an image is decoded, in the thread that answers all clients: 400 kB of progressive
# JPEG with 10,796 scans took 32 s, and 4096 x 4096 pixels 1 s each. What is sent is 17 kB.
MAX_IMAGE_BYTES = 1_000_000
MAX_PIXELS = 1 << 20  # 1280 x 720 is below
MAX_SCANS = 16  # of a JPEG; a progressive one has 10

_NUMBER = re.compile(r"[+-]?\d{1,12}([.,]\d{1,12})?([eE][+-]?\d{1,3})?$")


class TelemetryError(ValueError):
    """There is no picture to drive by. `kind` is the same for all of its sort, to be counted."""

    def __init__(self, kind: str, detail: str = "") -> None:
        super().__init__(f"{kind}: {detail}" if detail else kind)
        self.kind = kind


@dataclass(frozen=True)
class Telemetry:
    """A telemetry message.

    Attributes:
        frame: uint8 [160, 320, 3] RGB, decoded as in training.
        picture: its bytes as they came, JPEG or PNG.
        speed_mph: 0 or more; None where it could not be read.
        cross_track_m: metres from the centre line; NaN where the simulator does not send it.
        lane_m: half the width of the road; None where the simulator does not send it.
        at_wall: a wall holds the car.
        can_put_back: the simulator puts the car back on the road when a reply asks for it.
        oddities: what was put up with, each `(kind, detail)`.
    """

    frame: np.ndarray
    picture: bytes
    speed_mph: float | None
    cross_track_m: float
    lane_m: float | None
    at_wall: bool
    can_put_back: bool
    oddities: tuple[tuple[str, str], ...]


def decimal_sign(data: object) -> str | None:
    """The sign between units and decimals in the telemetry's numbers; None where it can't be told.

    >>> decimal_sign({"speed": "9,0000"}), decimal_sign({"speed": "-12.5000"}), decimal_sign([])
    (',', '.', None)
    """
    if not isinstance(data, dict):
        return None
    texts = [data.get(name) for name in NUMBERS]
    if any(isinstance(text, int | float) for text in texts):
        return "."  # JSON's own numbers, from a client of today
    # There are always four decimals; a sign elsewhere could be one between thousands.
    signs = [text[-5:-4] for text in texts if isinstance(text, str)]
    return next((sign for sign in signs if sign in (".", ",")), None)


def read_telemetry(data: object) -> Telemetry:
    """A `telemetry` event's argument, which is not null.

    Raises:
        TelemetryError: there is no picture in it.
    """
    if not isinstance(data, dict):
        raise TelemetryError("telemetry is no object", f"{data!r:.60}")
    picture = _picture(data.get("image"))
    try:
        width, height = _affordable_size(picture)
        frame = decode_image(picture)
    except (ValueError, cv2.error) as error:
        raise TelemetryError("image cannot be read", str(error)) from None
    oddities = []
    if (width, height) != (FRAME_WIDTH, FRAME_HEIGHT):
        detail = f"{width} x {height}, resized to {FRAME_WIDTH} x {FRAME_HEIGHT}"
        oddities.append(("picture of another size", detail))
    speed = parse_number(data.get("speed"))
    if speed is None:
        text = f"{data.get('speed')!r:.40}"
        oddities.append(("speed is no number, the last one is used", text))
    elif speed < 0:
        oddities.append(("speed is negative, taken as 0", f"{speed:g}"))
        speed = 0.0
    cross_track = parse_number(data.get("cte"))
    return Telemetry(
        frame,
        picture,
        speed,
        math.nan if cross_track is None else cross_track,
        lane_m=parse_number(data.get("lane")),
        at_wall=bool(parse_number(data.get("wall"))),
        can_put_back=bool(parse_number(data.get("put_back"))),
        oddities=tuple(oddities),
    )


def parse_number(value: object) -> float | None:
    """A finite number, from JSON's or from a text with either decimal sign; None for the rest.

    >>> parse_number("9,2500"), parse_number(9.25), parse_number("1,234.5"), parse_number("NaN")
    (9.25, 9.25, None, None)
    """
    if isinstance(value, str):
        if not _NUMBER.match(value.strip()):
            return None
        value = value.strip().replace(",", ".")
    elif isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        number = float(value)
    except OverflowError:  # an int of JSON's has no largest
        return None
    return number if math.isfinite(number) else None


def _picture(image: object) -> bytes:
    if isinstance(image, bytes):  # a client of today may send it as it is
        return image
    if not isinstance(image, str):
        raise TelemetryError("telemetry has no image")
    try:
        return base64.b64decode(image)
    except (binascii.Error, ValueError) as error:
        raise TelemetryError("image is no base64", str(error)) from None


def _affordable_size(picture: bytes) -> tuple[int, int]:
    """Return width and height of an image that takes milliseconds to decode.

    Raises:
        ValueError: it exceeds a limit, or is no image.
    """
    if len(picture) > MAX_IMAGE_BYTES:
        raise ValueError(f"the file has {len(picture):,} bytes, the limit is {MAX_IMAGE_BYTES:,}")
    width, height = _picture_size(picture)
    if width * height > MAX_PIXELS:
        raise ValueError(f"the image is {width} x {height}, the limit is {MAX_PIXELS:,} pixels")
    if fault := find_scan_fault(picture, MAX_SCANS):
        raise ValueError(fault)
    return width, height


def _picture_size(picture: bytes) -> tuple[int, int]:
    """Width and height as the file's head tells them, without decoding it."""
    size = jpeg_size(picture)
    if size is not None:
        return size
    try:
        with Image.open(io.BytesIO(picture)) as head:
            return head.size
    except Exception as error:  # Pillow fails in any way on bytes of any kind
        raise ValueError(f"the file is no JPEG or PNG ({type(error).__name__})") from None

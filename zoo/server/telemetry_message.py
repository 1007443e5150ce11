"""Telemetry messages, read whatever a client sends, and the replies to them."""

import base64
import binascii
import io
import math
from dataclasses import dataclass

import cv2
import numpy as np
from PIL import Image

from datamodules.image import decode_image, find_scan_fault, jpeg_size
from zoo.base.limits import MOST_MPH, parse_number
from zoo.base.rig import UDACITY
from zoo.driving.drive_record import DriveRow

NUMBERS = ("steering_angle", "throttle", "speed")
PUT_BACK = "put_back"  # key of a reply: speed of the car that is put back on the centre
# Limits of an image, checked before it is decoded in the thread that answers all clients: a
# progressive JPEG of 400 kB with 10,796 scans took 32 s, and one of 4096 x 4096 pixels 1 s. A
# simulator's image has 17 kB.
MAX_IMAGE_BYTES = 1_000_000
MAX_PIXELS = 1 << 20  # more than 1280 x 720
MAX_SCANS = 16  # of a JPEG; a progressive JPEG usually has 10
MOST_DEGREES, MOST_LANE_M = 90.0, 100.0  # of a car's wheels; half of a road's width


class TelemetryError(ValueError):
    """Telemetry without a usable image.

    Args:
        kind: kind of the error in words, by which errors are counted.
        detail: what is wrong with this telemetry.
    """

    def __init__(self, kind: str, detail: str = "") -> None:
        super().__init__(f"{kind}: {detail}" if detail else kind)
        self.kind, self.detail = kind, detail


@dataclass(frozen=True)
class Telemetry:
    """A telemetry message.

    Attributes:
        frame: uint8 [H, W, 3] RGB, decoded as in training.
        image: bytes of the frame as sent, JPEG or PNG.
        speed_mph: speed of the car, 0 or more; NaN if it is unknown.
        steering: steering of the wheels, -1..1; None if it is unknown.
        cross_track_m: distance from the centreline in metres, positive is right; NaN if the
            simulator does not send it.
        lane_m: half the width of the road in metres; None if the simulator does not send it.
        at_wall: whether a wall holds the car.
        can_put_back: whether the simulator can put the car back on the road.
        lap: number of the lap from 1; None if the simulator does not send it.
        xy: position of the car in metres; None if the simulator does not send it.
        oddities: faults that were tolerated, each `(kind, detail)`.
    """

    frame: np.ndarray
    image: bytes
    speed_mph: float
    steering: float | None
    cross_track_m: float
    lane_m: float | None
    at_wall: bool
    can_put_back: bool
    lap: float | None
    xy: tuple[float, float] | None
    oddities: tuple[tuple[str, str], ...]


def decimal_sign(data: object) -> str | None:
    """Return the decimal sign of the telemetry's numbers; None if they do not show it.

    >>> decimal_sign({"speed": "9,0000"}), decimal_sign({"speed": "-12.5000"}), decimal_sign([])
    (',', '.', None)
    """
    if not isinstance(data, dict):
        return None
    texts = [data.get(name) for name in NUMBERS]
    if any(isinstance(text, int | float) for text in texts):
        return "."  # JSON numbers, of current clients
    # The original writes four decimals; a sign elsewhere could separate thousands.
    signs = [text[-5:-4] for text in texts if isinstance(text, str)]
    return next((sign for sign in signs if sign in (".", ",")), None)


def read_telemetry(data: object) -> Telemetry:
    """Read the argument of a `telemetry` event, which is not null.

    Raises:
        TelemetryError: the argument has no usable image.
    """
    if not isinstance(data, dict):
        raise TelemetryError("telemetry is no object", f"{data!r:.60}")
    image = _image(data.get("image"))
    try:
        _check_affordable(image)
        frame = decode_image(image)
    except (ValueError, cv2.error) as error:
        raise TelemetryError("image cannot be read", str(error)) from None
    oddities = []
    speed = parse_number(data.get("speed"), MOST_MPH)
    if speed is None:
        speed = math.nan
        oddities.append(("speed is unknown; no speed is held", f"{data.get('speed')!r:.40}"))
    elif speed < 0:
        oddities.append(("speed is negative; 0 is used", f"{speed:g}"))
        speed = 0.0
    degrees = parse_number(data.get("steering_angle"), MOST_DEGREES)
    x, y = parse_number(data.get("x")), parse_number(data.get("y"))
    cross_track = parse_number(data.get("cte"))
    return Telemetry(
        frame,
        image,
        speed,
        None if degrees is None else degrees / UDACITY.steering_deg,
        math.nan if cross_track is None else cross_track,
        lane_m=parse_number(data.get("lane"), MOST_LANE_M),
        at_wall=bool(parse_number(data.get("wall"))),
        can_put_back=bool(parse_number(data.get("put_back"))),
        lap=parse_number(data.get("lap")),
        xy=None if x is None or y is None else (x, y),
        oddities=tuple(oddities),
    )


def _image(image: object) -> bytes:
    if isinstance(image, bytes):  # a current client may send bytes
        return image
    if not isinstance(image, str):
        raise TelemetryError("telemetry has no image")
    try:
        return base64.b64decode(image)
    except (binascii.Error, ValueError) as error:
        raise TelemetryError("image is no base64", str(error)) from None


def _check_affordable(image: bytes) -> None:
    """Check by its header that an image is fast to decode.

    Raises:
        ValueError: the image exceeds a limit, or is no image.
    """
    if len(image) > MAX_IMAGE_BYTES:
        raise ValueError(f"the file has {len(image):,} bytes, the limit is {MAX_IMAGE_BYTES:,}")
    size = jpeg_size(image)
    if size is None:
        try:
            with Image.open(io.BytesIO(image)) as head:
                size = head.size
        except Exception as error:  # Pillow raises many types of exceptions for arbitrary bytes
            raise ValueError(f"the file is no JPEG or PNG ({type(error).__name__})") from None
    width, height = size
    if width * height > MAX_PIXELS:
        raise ValueError(f"the image is {width} x {height}, the limit is {MAX_PIXELS:,} pixels")
    if fault := find_scan_fault(image, MAX_SCANS):
        raise ValueError(fault)


@dataclass(frozen=True)
class Reply:
    """Reply to a telemetry.

    Attributes:
        event: name of the event to send.
        values: argument of the event.
        row: row of the drive.
        image: image to record, as the client sent it; None to record none.
        begins: whether it is the first after the car was put back, a person drove, or another car
            was recorded.
    """

    event: str
    values: dict[str, str]
    row: DriveRow
    image: bytes | None = None
    begins: bool = False


def reply_values(steering: float, throttle: float, decimal: str) -> dict[str, str]:
    """Return the argument of a `steer` event, with the client's own decimal sign.

    >>> reply_values(0.05, 0.2, ",")
    {'steering_angle': '0,0500', 'throttle': '0,2000'}
    """
    pair = {"steering_angle": steering, "throttle": throttle}
    return {name: number_text(value, decimal) for name, value in pair.items()}


def number_text(value: float, decimal: str) -> str:
    """Return a number with four decimals and the client's decimal sign."""
    return f"{value:.4f}".replace(".", decimal)

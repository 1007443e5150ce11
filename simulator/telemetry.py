"""The original's messages: telemetry out, `steer` and `manual` in, with the quirks of its C#."""

import base64
import re

import cv2
import numpy as np

from simulator.rig import MAX_STEERING_DEG

LARGEST_FLOAT = 3.4028235e38  # of 32 bits; Mono throws for what is larger
FASTEST_MPH = 100.0  # at which a reply sets the car down on the road
JPEG_QUALITY = 75  # what the original's pictures have


def make_telemetry(
    frame: np.ndarray,
    steering: float,
    throttle: float,
    speed_mph: float,
    decimal_comma: bool,
    truth: dict[str, float] | None = None,
) -> dict[str, str]:
    """The original's telemetry: strings with four decimals, the steering in degrees (-25..25), the
    speed in mph, and the frame (uint8 [160, 320, 3] RGB) as a base64 JPEG. `truth` adds numbers
    that the original does not tell."""
    bgr = cv2.cvtColor(frame, cv2.COLOR_RGB2BGR)
    jpeg = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1]
    numbers = {
        "steering_angle": steering * MAX_STEERING_DEG,
        "throttle": throttle,
        "speed": speed_mph,
        **(truth or {}),
    }
    texts = {key: f"{value + 0.0:.4f}" for key, value in numbers.items()}
    if decimal_comma:
        texts = {key: text.replace(".", ",") for key, text in texts.items()}
    return {**texts, "image": base64.b64encode(jpeg.tobytes()).decode()}


def read_steer(data: object, decimal_comma: bool) -> tuple[float, float]:
    """Steering and throttle, each clamped to -1..1, of a `steer` event's argument.

    Raises:
        ValueError: the original would swallow it; the message says why.
    """
    if not isinstance(data, dict):
        raise ValueError(f"its argument is {type(data).__name__}, expected one object")
    values = []
    for key in ("steering_angle", "throttle"):
        if key not in data:
            raise ValueError(f"it has no {key}")
        if not isinstance(data[key], str):
            raise ValueError(f"{key} is {data[key]!r}, expected a string")
        values.append(parse_float(data[key], decimal_comma))
        if values[-1] is None:
            raise ValueError(f"{key} is {data[key]!r}, which C#'s float.Parse does not take")
    return tuple(min(max(value, -1.0), 1.0) for value in values)


def read_put_back(data: dict, decimal_comma: bool) -> float | None:
    """Speed in mph at which a `steer` event puts the car back on the road; None where it does not.

    The original ignores the key.
    """
    text = data.get("put_back")
    speed_mph = parse_float(text, decimal_comma) if isinstance(text, str) else None
    return None if speed_mph is None else min(max(speed_mph, 0.0), FASTEST_MPH)


def parse_float(text: str, decimal_comma: bool) -> float | None:
    """C#'s `float.Parse` in a locale; None where it throws. Separators of thousands count for
    nothing, wherever they stand.

    >>> parse_float("0.05", False), parse_float("0,05", True), parse_float("0.1000", True)
    (0.05, 0.05, 1000.0)
    >>> parse_float("nan", False) is None
    True
    """
    decimal, thousands = (",", r"\.") if decimal_comma else (r"\.", ",")
    pattern = rf"\s*[+-]?(\d[\d{thousands}]*({decimal}\d*)?|{decimal}\d+)([eE][+-]?\d+)?\s*"
    if not re.fullmatch(pattern, text, re.ASCII):
        return None
    plain = re.sub(thousands, "", text)
    value = float(plain.replace(",", "."))
    return value if abs(value) <= LARGEST_FLOAT else None

"""The original's messages, with the number formats of its C# code: telemetry and `steer`."""

import base64
import re

import numpy as np

from zoo.simulator.recorder import encode
from zoo.simulator.udacity_car import MAX_STEERING_DEG

LARGEST_FLOAT = 3.4028235e38  # largest float of 32 bits; Mono's float.Parse throws beyond it
FASTEST_MPH = 100.0  # highest speed at which a reply may put the car back


def make_telemetry(
    frame: np.ndarray,
    steering: float,
    throttle: float,
    speed_mph: float,
    decimal_comma: bool,
    truth: dict[str, float] | None = None,
) -> dict[str, str]:
    """Return a telemetry message as the original sends it.

    Numbers are strings with four decimals, the image is a base64 JPEG.

    Args:
        frame: uint8 [160, 320, 3], RGB.
        steering: steering command, -1..1; the message has degrees, -25..25.
        throttle: throttle command, -1..1.
        speed_mph: speed in mph.
        decimal_comma: whether numbers have a decimal comma.
        truth: numbers to add that the original does not send.
    """
    numbers = {
        "steering_angle": steering * MAX_STEERING_DEG,
        "throttle": throttle,
        "speed": speed_mph,
        **(truth or {}),
    }
    texts = {key: f"{value + 0.0:.4f}" for key, value in numbers.items()}
    if decimal_comma:
        texts = {key: text.replace(".", ",") for key, text in texts.items()}
    return {**texts, "image": image_text(frame)}


def image_text(frame: np.ndarray) -> str:
    """Return a frame, uint8 [H, W, 3] RGB, as a base64 JPEG."""
    return base64.b64encode(encode(frame)).decode()


def read_steer(data: object, decimal_comma: bool) -> tuple[float, float]:
    """Return steering and throttle of a `steer` event's argument, each clamped to -1..1.

    Raises:
        ValueError: the original discards such an argument; the message has the reason.
    """
    if not isinstance(data, dict):
        raise ValueError(f"its argument is {type(data).__name__}, expected one object")
    values = []
    for key in ("steering_angle", "throttle"):
        if key not in data:
            raise ValueError(f"it has no {key}")
        if not isinstance(data[key], str):
            raise ValueError(f"{key} is {data[key]!r}, expected a string")
        if (value := parse_float(data[key], decimal_comma)) is None:
            raise ValueError(f"{key} is {data[key]!r}, which C#'s float.Parse does not take")
        values.append(min(max(value, -1.0), 1.0))
    steering, throttle = values
    return steering, throttle


def read_put_back(data: object, decimal_comma: bool) -> float | None:
    """Return the speed in mph at which a `steer` event puts the car back on the road.

    The result is None for an event that does not put it back. The original ignores the key.
    """
    text = data.get("put_back") if isinstance(data, dict) else None
    speed_mph = parse_float(text, decimal_comma) if isinstance(text, str) else None
    return None if speed_mph is None else min(max(speed_mph, 0.0), FASTEST_MPH)


def parse_float(text: str, decimal_comma: bool) -> float | None:
    """Parse a number as C#'s `float.Parse` does; return None where it throws.

    Thousands separators are ignored, also in wrong places.

    >>> parse_float("0.05", False), parse_float("0,05", True), parse_float("0.1000", True)
    (0.05, 0.05, 1000.0)
    >>> parse_float("nan", False) is None
    True
    """
    decimal, thousands = (",", r"\.") if decimal_comma else (r"\.", ",")
    pattern = rf"\s*[+-]?(\d[\d{thousands}]*({decimal}\d*)?|{decimal}\d+)([eE][+-]?\d+)?\s*"
    if not re.fullmatch(pattern, text, re.ASCII):
        return None
    value = float(re.sub(thousands, "", text).replace(",", "."))
    return value if abs(value) <= LARGEST_FLOAT else None

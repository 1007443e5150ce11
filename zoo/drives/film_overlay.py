"""What a film of a drive shows over the camera's picture: wheel, speed, pedals, autonomy."""

import functools
import importlib.util
import math
from pathlib import Path

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from datamodules.samples import MAX_STEERING_DEG

SCALE = 3  # 960 x 480
WHEEL_RATIO = 6.0  # the wheel drawn turns so much further than the front wheels
WHITE, GREY, GREEN, RED, AMBER = (
    (255, 255, 255),
    (190, 196, 204),
    (92, 214, 130),
    (255, 92, 80),
    (255, 184, 64),
)
BAND = 104  # pixels at the bottom that are darkened for the instruments, over the car's bonnet
_SUBPIXEL = 4  # bits of a fraction in OpenCV's coordinates


def draw_overlay(
    frame: np.ndarray,
    steering: float | None,
    throttle: float | None,
    speed_mph: float | None,
    autonomy: float | None = None,
    cte_m: float | None = None,
    note: str | None = None,
) -> np.ndarray:
    """A camera's picture, enlarged, with the drive's state drawn in.

    Args:
        frame: uint8 [H, W, 3], RGB; 160 x 320 from the simulator.
        steering: -1..1, left is negative; None or NaN (as any of these) where it is not known.
        throttle: -1..1, negative brakes.
        speed_mph: of the car.
        autonomy: 0..1, NVIDIA's measure so far.
        cte_m: metres right of the centreline.
        note: a few words, such as who drives.

    Returns:
        uint8 [3 H, 3 W, 3], RGB.
    """
    steering, throttle, speed_mph, autonomy, cte_m = (
        value if value is not None and math.isfinite(value) else None
        for value in (steering, throttle, speed_mph, autonomy, cte_m)
    )
    height, width = frame.shape[0] * SCALE, frame.shape[1] * SCALE
    picture = cv2.resize(frame, (width, height), interpolation=cv2.INTER_CUBIC)
    if any(value is not None for value in (steering, throttle, speed_mph)):
        _darken(picture, height - BAND, height)
    if steering is not None:
        _draw_wheel(picture, (70, height - 54), 40, steering * MAX_STEERING_DEG * WHEEL_RATIO)
        degrees = f"{steering * MAX_STEERING_DEG + 0.0:+.1f}°".replace("-", "\N{MINUS SIGN}")
        _write(picture, degrees, 128, height - 57, 26, WHITE)
        _write(picture, "STEERING", 128, height - 26, 13, GREY)
        _draw_steering_bar(picture, (width // 2, height - 40), 150, steering)
    if speed_mph is not None:
        _write(picture, f"{speed_mph:.1f}", width - 84, height - 50, 38, WHITE, "right")
        _write(picture, "mph", width - 76, height - 43, 17, GREY)
    if throttle is not None:
        _draw_pedals(picture, (width - 208, height - 20), 184, throttle)
    _draw_state(picture, autonomy, cte_m)
    if note:
        _draw_note(picture, note)
    return picture


def _draw_state(picture: np.ndarray, autonomy: float | None, cte_m: float | None) -> None:
    """Top right: a line each."""
    lines = []
    if autonomy is not None:
        colour = GREEN if autonomy >= 0.995 else AMBER if autonomy >= 0.9 else RED
        lines.append(("AUTONOMY", f"{autonomy:.1%}", colour))
    if cte_m is not None:
        lines.append(
            ("OFF CENTRE", f"{abs(cte_m):.2f} m {'right' if cte_m > 0 else 'left'}", WHITE)
        )
    if not lines:
        return
    width, right = 268, picture.shape[1] - 20
    _shade(picture, right - width, 18, right, 18 + 14 + 30 * len(lines))
    for number, (label, text, colour) in enumerate(lines):
        y = 40 + 30 * number
        _write(picture, label, right - width + 14, y, 13, GREY)
        _write(picture, text, right - 14, y, 20, colour, "right")


def _draw_note(picture: np.ndarray, note: str) -> None:
    width = _letters(note, 18).shape[1]
    _shade(picture, 20, 18, 20 + width + 28, 54)
    _write(picture, note, 34, 36, 18, WHITE)


def _draw_wheel(
    picture: np.ndarray, centre: tuple[int, int], radius: int, angle_deg: float
) -> None:
    cv2.circle(picture, centre, radius, WHITE, 6, cv2.LINE_AA)
    angle = np.radians(angle_deg)
    for spoke in (np.pi, 0, np.pi / 2):  # left, right, down
        way = np.array([np.cos(angle + spoke), np.sin(angle + spoke)])
        _line(picture, centre + 9 * way, centre + (radius - 2) * way, WHITE, 6)
    cv2.circle(picture, centre, 10, WHITE, -1, cv2.LINE_AA)
    # A mark at twelve o'clock, as on a racing wheel: it shows the angle at a glance.
    mark = np.degrees(angle) - 90
    cv2.ellipse(picture, centre, (radius, radius), mark, -11, 11, AMBER, 6, cv2.LINE_AA)


def _draw_steering_bar(
    picture: np.ndarray, centre: tuple[int, int], half: int, steering: float
) -> None:
    """From the middle to where the steering is, full lock at the ends."""
    middle = np.array(centre, float)
    _line(picture, middle - (half, 0), middle + (half, 0), (110, 116, 124), 4)
    if abs(steering) > 0.004:
        _line(picture, middle, middle + (half * float(np.clip(steering, -1, 1)), 0), AMBER, 8)
    _line(picture, middle - (0, 9), middle + (0, 9), WHITE, 2)


def _draw_pedals(picture: np.ndarray, start: tuple[int, int], length: int, throttle: float) -> None:
    """A bar: green for throttle, red for the brake."""
    begin = np.array(start, float)
    _line(picture, begin, begin + (length, 0), (110, 116, 124), 6)
    share = min(abs(throttle), 1.0)
    if share > 0.005:
        _line(picture, begin, begin + (length * share, 0), GREEN if throttle > 0 else RED, 6)


def _line(
    picture: np.ndarray, start: np.ndarray, end: np.ndarray, colour: tuple, thickness: int
) -> None:
    first, last = (np.round(np.array([start, end]) * (1 << _SUBPIXEL))).astype(int).tolist()
    cv2.line(picture, first, last, colour, thickness, cv2.LINE_AA, _SUBPIXEL)


def _darken(picture: np.ndarray, top: int, bottom: int) -> None:
    """Fade rows towards black, so that what is written there can be read on any road."""
    light = 1 - 0.72 * np.linspace(0, 1, bottom - top) ** 0.6
    picture[top:bottom] = (picture[top:bottom] * light[:, None, None]).astype(np.uint8)


def _shade(picture: np.ndarray, left: int, top: int, right: int, bottom: int) -> None:
    """A dark glass with round corners."""
    patch = picture[top:bottom, left:right]
    share = 0.55 * _round_mask(bottom - top, right - left)[..., None]
    patch[:] = (patch * (1 - share) + np.array((12, 16, 22)) * share).astype(np.uint8)


@functools.lru_cache(64)
def _round_mask(height: int, width: int) -> np.ndarray:
    """float64 [height, width], 1 inside a rectangle with round corners, smooth at its rim."""
    image = Image.new("L", (4 * width, 4 * height))
    ImageDraw.Draw(image).rounded_rectangle((0, 0, 4 * width - 1, 4 * height - 1), 40, fill=255)
    return np.asarray(image.resize((width, height), Image.Resampling.BOX)) / 255


def _write(
    picture: np.ndarray, text: str, x: int, y: int, size: int, colour: tuple, side: str = "left"
) -> None:
    """Text whose middle line is at `y` and whose `side` is at `x`; what is beyond is cut off."""
    letters = _letters(text, size)
    height, width = letters.shape
    left, top = (x if side == "left" else x - width), y - height // 2
    letters = letters[max(-top, 0) :, max(-left, 0) :]
    left, top = max(left, 0), max(top, 0)
    patch = picture[top : top + letters.shape[0], left : left + letters.shape[1]]
    share = letters[: patch.shape[0], : patch.shape[1], None]
    patch[:] = (patch * (1 - share) + np.array(colour) * share).astype(np.uint8)


@functools.lru_cache(1024)
def _letters(text: str, size: int) -> np.ndarray:
    """float64 [H, W] in 0..1: how much of each pixel a text covers. Its digits are equally wide."""
    font = _font(size)
    left, _, right, _ = font.getbbox(text)
    ascent, descent = font.getmetrics()
    image = Image.new("L", (max(int(right - left), 1), ascent + descent))
    ImageDraw.Draw(image).text((-left, 0), text, fill=255, font=font)
    return np.asarray(image) / 255


@functools.lru_cache(16)
def _font(size: int) -> ImageFont.FreeTypeFont:
    # matplotlib brings the letters along, so that films look the same on every machine; found
    # without importing it, which takes half a second.
    spec = importlib.util.find_spec("matplotlib")
    assert spec is not None
    assert spec.origin is not None
    package = Path(spec.origin).parent
    name = "DejaVuSans-Bold.ttf" if size >= 20 else "DejaVuSans.ttf"
    return ImageFont.truetype(str(package / "mpl-data" / "fonts" / "ttf" / name), size)

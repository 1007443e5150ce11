"""Drawing of a drive's state on camera frames, for films: wheel, speed, pedals, autonomy."""

import functools
import importlib.util
import math
from pathlib import Path

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from zoo.base.rig import UDACITY
from zoo.drives.drive_record import BAND

SCALE = 3  # 960 x 480
WHEEL_RATIO = 6.0  # angle of the drawn steering wheel per angle of the front wheels
WHITE, GREY, GREEN, RED, AMBER = (
    (255, 255, 255),
    (190, 196, 204),
    (92, 214, 130),
    (255, 92, 80),
    (255, 184, 64),
)
PANEL = 104  # height in pixels of the darkened band for the instruments, over the car's bonnet
_SUBPIXEL = 4  # fractional bits of OpenCV's coordinates


def draw_overlay(
    frame: np.ndarray,
    steering: float | None = None,
    throttle: float | None = None,
    speed_mph: float | None = None,
    autonomy: float | None = None,
    cte_m: float | None = None,
    note: str | None = None,
    spread: float | None = None,
) -> np.ndarray:
    """Return an enlarged camera frame with the drive's state drawn in.

    A state that is None or NaN is not drawn.

    Args:
        frame: camera frame, uint8 [H, W, 3] RGB; 160 x 320 from the simulator.
        steering: steering, -1..1, negative is left.
        throttle: throttle, -1..1, negative brakes.
        speed_mph: speed of the car.
        autonomy: NVIDIA's autonomy so far, 0..1.
        cte_m: cross-track error in metres, positive is right of the centreline.
        note: short text, such as the name of the driver.
        spread: standard deviation of the steering; a band shows where 95 % of a normal distribution
            would be.

    Returns:
        uint8 [3 H, 3 W, 3], RGB.
    """
    steering, throttle, speed_mph, autonomy, cte_m, spread = (
        value if value is not None and math.isfinite(value) else None
        for value in (steering, throttle, speed_mph, autonomy, cte_m, spread)
    )
    height, width = frame.shape[0] * SCALE, frame.shape[1] * SCALE
    image = cv2.resize(frame, (width, height), interpolation=cv2.INTER_CUBIC)
    if any(value is not None for value in (steering, throttle, speed_mph)):
        _darken(image, height - PANEL, height)
    if steering is not None:
        _draw_wheel(image, (70, height - 54), 40, steering * UDACITY.steering_deg * WHEEL_RATIO)
        degrees = f"{steering * UDACITY.steering_deg + 0.0:+.1f}°".replace("-", "\N{MINUS SIGN}")
        _write(image, degrees, 128, height - 57, 26, WHITE)
        doubt = "" if spread is None else f" ±{BAND * spread * UDACITY.steering_deg:.1f}°"
        _write(image, f"STEERING{doubt}", 128, height - 26, 13, GREY)
        _draw_steering_bar(image, (width // 2, height - 40), 150, steering, spread or 0.0)
    if speed_mph is not None:
        _write(image, f"{speed_mph:.1f}", width - 84, height - 50, 38, WHITE, "right")
        _write(image, "mph", width - 76, height - 43, 17, GREY)
    if throttle is not None:
        _draw_pedals(image, (width - 208, height - 20), 184, throttle)
    _draw_state(image, autonomy, cte_m)
    if note:
        _draw_note(image, note)
    return image


def _draw_state(image: np.ndarray, autonomy: float | None, cte_m: float | None) -> None:
    """Draw autonomy and cross-track error at the top right, one line each."""
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
    width, right = 268, image.shape[1] - 20
    _shade(image, right - width, 18, right, 18 + 14 + 30 * len(lines))
    for number, (label, text, colour) in enumerate(lines):
        y = 40 + 30 * number
        _write(image, label, right - width + 14, y, 13, GREY)
        _write(image, text, right - 14, y, 20, colour, "right")


def _draw_note(image: np.ndarray, note: str) -> None:
    width = _letters(note, 18).shape[1]
    _shade(image, 20, 18, 20 + width + 28, 54)
    _write(image, note, 34, 36, 18, WHITE)


def _draw_wheel(image: np.ndarray, centre: tuple[int, int], radius: int, angle_deg: float) -> None:
    cv2.circle(image, centre, radius, WHITE, 6, cv2.LINE_AA)
    angle = np.radians(angle_deg)
    for spoke in (np.pi, 0, np.pi / 2):  # left, right, down
        way = np.array([np.cos(angle + spoke), np.sin(angle + spoke)])
        _line(image, centre + 9 * way, centre + (radius - 2) * way, WHITE, 6)
    cv2.circle(image, centre, 10, WHITE, -1, cv2.LINE_AA)
    # A mark at the top, as on a racing wheel, makes the angle visible.
    mark = np.degrees(angle) - 90
    cv2.ellipse(image, centre, (radius, radius), mark, -11, 11, AMBER, 6, cv2.LINE_AA)


def _draw_steering_bar(
    image: np.ndarray, centre: tuple[int, int], half: int, steering: float, spread: float
) -> None:
    """Draw a bar from the middle to the steering, with its band; its ends are full lock."""
    middle = np.array(centre, float)
    if spread > 0:
        first, last = np.clip((steering - BAND * spread, steering + BAND * spread), -1, 1)
        left, right = round(centre[0] + half * first), round(centre[0] + half * last)
        patch = image[centre[1] - 13 : centre[1] + 14, left : right + 1]
        patch[:] = (0.6 * patch + 0.4 * np.array(AMBER)).astype(np.uint8)
    _line(image, middle - (half, 0), middle + (half, 0), (110, 116, 124), 4)
    if abs(steering) > 0.004:
        _line(image, middle, middle + (half * float(np.clip(steering, -1, 1)), 0), AMBER, 8)
    _line(image, middle - (0, 9), middle + (0, 9), WHITE, 2)


def _draw_pedals(image: np.ndarray, start: tuple[int, int], length: int, throttle: float) -> None:
    """Draw a bar: green for throttle, red for the brake."""
    begin = np.array(start, float)
    _line(image, begin, begin + (length, 0), (110, 116, 124), 6)
    share = min(abs(throttle), 1.0)
    if share > 0.005:
        _line(image, begin, begin + (length * share, 0), GREEN if throttle > 0 else RED, 6)


def _line(
    image: np.ndarray, start: np.ndarray, end: np.ndarray, colour: tuple, thickness: int
) -> None:
    first, last = (np.round(np.array([start, end]) * (1 << _SUBPIXEL))).astype(int).tolist()
    cv2.line(image, first, last, colour, thickness, cv2.LINE_AA, _SUBPIXEL)


def _darken(image: np.ndarray, top: int, bottom: int) -> None:
    """Fade rows towards black, so that text on them is readable on any road."""
    light = 1 - 0.72 * np.linspace(0, 1, bottom - top) ** 0.6
    image[top:bottom] = (image[top:bottom] * light[:, None, None]).astype(np.uint8)


def _shade(image: np.ndarray, left: int, top: int, right: int, bottom: int) -> None:
    """Darken a rectangle with round corners."""
    patch = image[top:bottom, left:right]
    share = 0.55 * _round_mask(bottom - top, right - left)[..., None]
    patch[:] = (patch * (1 - share) + np.array((12, 16, 22)) * share).astype(np.uint8)


@functools.lru_cache(64)
def _round_mask(height: int, width: int) -> np.ndarray:
    """Return float64 [height, width]: 1 inside a rectangle with round corners, 0 outside."""
    image = Image.new("L", (4 * width, 4 * height))
    ImageDraw.Draw(image).rounded_rectangle((0, 0, 4 * width - 1, 4 * height - 1), 40, fill=255)
    return np.asarray(image.resize((width, height), Image.Resampling.BOX)) / 255


def _write(
    image: np.ndarray, text: str, x: int, y: int, size: int, colour: tuple, side: str = "left"
) -> None:
    """Write text vertically centred at `y`, with its `side` at `x`; clip it at the borders."""
    letters = _letters(text, size)
    height, width = letters.shape
    left, top = (x if side == "left" else x - width), y - height // 2
    letters = letters[max(-top, 0) :, max(-left, 0) :]
    left, top = max(left, 0), max(top, 0)
    patch = image[top : top + letters.shape[0], left : left + letters.shape[1]]
    share = letters[: patch.shape[0], : patch.shape[1], None]
    patch[:] = (patch * (1 - share) + np.array(colour) * share).astype(np.uint8)


@functools.lru_cache(1024)
def _letters(text: str, size: int) -> np.ndarray:
    """Return the coverage of each pixel by a text, float64 [H, W] in 0..1."""
    font = _font(size)
    left, _, right, _ = font.getbbox(text)
    ascent, descent = font.getmetrics()
    image = Image.new("L", (max(int(right - left), 1), ascent + descent))
    ImageDraw.Draw(image).text((-left, 0), text, fill=255, font=font)
    return np.asarray(image) / 255


@functools.lru_cache(16)
def _font(size: int) -> ImageFont.FreeTypeFont:
    # matplotlib's own font makes films look the same on every machine. find_spec avoids importing
    # matplotlib, which takes 0.5 s. The font's digits are equally wide.
    spec = importlib.util.find_spec("matplotlib")
    assert spec is not None
    assert spec.origin is not None
    package = Path(spec.origin).parent
    name = "DejaVuSans-Bold.ttf" if size >= 20 else "DejaVuSans.ttf"
    return ImageFont.truetype(str(package / "mpl-data" / "fonts" / "ttf" / name), size)

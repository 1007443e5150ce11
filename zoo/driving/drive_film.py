"""Films of drives: the state drawn on camera frames, and the frames kept from a scored drive."""

import functools
import importlib.util
import math
from pathlib import Path

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from datamodules.formats.recording_writer import write_frame
from zoo.base.rig import Rig
from zoo.base.video import Film
from zoo.driving.drive_record import BAND, DriveRow
from zoo.driving.tally import autonomy

FILM_NAME, FRAMES = "film.mp4", "frames"
FILM_WIDTH = 640  # at 960 a lap takes twice the bytes
MOMENTS, APART_S = 10, 2.0
WIDTH = 960  # of a drawn frame
WHEEL_RATIO = 6.0  # angle of the drawn steering wheel per angle of the front wheels
UNKNOWN_LOCK_DEG = 25.0  # drawn of a car of unknown rig
WHITE, GREY, GREEN, RED, AMBER = (
    (255, 255, 255),
    (190, 196, 204),
    (92, 214, 130),
    (255, 92, 80),
    (255, 184, 64),
)
MAP = 150  # side in pixels of the small map
PANEL = 104  # height in pixels of the darkened band for the instruments, over the car's bonnet
Label = tuple[str, int, int, int, tuple[int, int, int], str]
_SUBPIXEL = 4  # fractional bits of OpenCV's coordinates


class WorstMoments:
    """Frames of a drive's worst moments, chosen while it runs, so that memory stays small.

    An intervention is worse than any other moment. Otherwise the moment farther from the
    centreline is worse.

    Args:
        count: greatest number of frames to keep.
        apart_s: least time between two kept moments, in seconds; the worse of two is kept.
    """

    def __init__(self, count: int = MOMENTS, apart_s: float = APART_S) -> None:
        self.count, self.apart_s = count, apart_s
        self.moments: list[tuple[int, DriveRow, np.ndarray]] = []  # in the order of time
        self._number = -1

    def __call__(self, frame: np.ndarray, row: DriveRow) -> None:
        """Take the next frame, uint8 [H, W, 3] RGB, and its row."""
        self._number += 1
        if self.moments and row.time_s - self.moments[-1][1].time_s < self.apart_s:
            if badness(row) <= badness(self.moments[-1][1]):
                return
            self.moments.pop()
        elif len(self.moments) >= self.count:
            least = min(self.moments, key=lambda one: badness(one[1]))
            if badness(least[1]) >= badness(row):
                return
            self.moments.remove(least)
        self.moments.append((self._number, row, frame.copy()))

    def write(self, folder: Path) -> dict[int, str]:
        """Write the frames as JPEG; return their paths within the folder by row number."""
        names = {}
        (folder / FRAMES).mkdir(parents=True, exist_ok=True)
        for number, _, frame in self.moments:
            names[number] = f"{FRAMES}/{number:06d}.jpg"
            write_frame(frame, folder / names[number])
        return names


def badness(row: DriveRow) -> tuple[bool, float]:
    """Return a sort key of a moment; the worst moment has the greatest."""
    return row.intervention, abs(row.cross_track_m)


class DriveFilm(Film):
    """Writer of `film.mp4` during a drive; steering, speed and autonomy are drawn in.

    Args:
        folder: folder of the drive.
        frame_rate: frames per second of simulated time.
        speed: playing speed as a multiple of the driven speed; 3 writes every third frame.
        rig: see `draw_overlay`.
        road: see `draw_overlay`.

    Raises:
        InputError: the film cannot be written.
    """

    def __init__(
        self,
        folder: Path,
        frame_rate: float,
        speed: float,
        rig: Rig | None,
        road: np.ndarray | None = None,
    ) -> None:
        self.every, self.rig, self.road = max(1, round(speed)), rig, road
        self.number = self.interventions = 0
        super().__init__(folder / FILM_NAME, frame_rate * speed / self.every)

    def __call__(
        self,
        frame: np.ndarray,
        row: DriveRow,
        lap: int | None = None,
        xy: tuple[float, float] | None = None,
    ) -> None:
        """Take the next frame, uint8 [H, W, 3] RGB, its row, and lap and place if known."""
        self.interventions += row.intervention
        self.number += 1
        if (self.number - 1) % self.every:
            return
        is_measured = not math.isnan(row.cross_track_m)
        share = autonomy(self.interventions, row.time_s) if is_measured else None
        image = draw_overlay(
            frame,
            row.steering,
            row.throttle,
            row.speed_mph,
            share,
            row.cross_track_m,
            spread=row.spread,
            rig=self.rig,
            time_s=row.time_s,
            lap=lap,
            road=self.road,
            xy=xy,
        )
        size = FILM_WIDTH, len(image) * FILM_WIDTH // WIDTH
        self.add(cv2.resize(image, size, interpolation=cv2.INTER_AREA))


def draw_overlay(
    frame: np.ndarray,
    steering: float | None = None,
    throttle: float | None = None,
    speed_mph: float | None = None,
    autonomy: float | None = None,
    cte_m: float | None = None,
    note: str | None = None,
    spread: float | None = None,
    rig: Rig | None = None,
    recorded: float | None = None,
    time_s: float | None = None,
    lap: int | None = None,
    road: np.ndarray | None = None,
    xy: tuple[float, float] | None = None,
) -> np.ndarray:
    """Return an enlarged camera frame with the drive's state drawn in.

    A state that is None or NaN is not drawn.

    Args:
        frame: camera frame, uint8 [H, W, 3] RGB.
        steering: steering, -1..1, negative is left.
        throttle: throttle, -1..1, negative brakes.
        speed_mph: speed of the car.
        autonomy: NVIDIA's autonomy so far, 0..1.
        cte_m: cross-track error in metres, positive is right of the centreline.
        note: short text, such as the name of the driver.
        spread: standard deviation of the steering; a band shows where 95 % of a normal distribution
            would be.
        rig: car whose wheels' angle is shown; None shows the steering itself.
        recorded: steering of the recorded driver, -1..1, in a replay.
        time_s: time of the drive.
        lap: number of the lap.
        road: points of the road for a small map, float [N, 2], m.
        xy: position of the car on the map, m.

    Returns:
        uint8 [960 H / W, 960, 3], RGB.
    """
    steering, throttle, speed_mph, autonomy, cte_m, spread, recorded = (
        value if value is not None and math.isfinite(value) else None
        for value in (steering, throttle, speed_mph, autonomy, cte_m, spread, recorded)
    )
    width, height = WIDTH, WIDTH * len(frame) // frame.shape[1]
    image = cv2.resize(frame, (width, height), interpolation=cv2.INTER_CUBIC)
    texts: list[Label] = []
    lines: list[tuple[str, str, tuple[int, int, int]]] = []
    if any(value is not None for value in (steering, throttle, speed_mph)):
        # Fade to black, so that text is readable on any road.
        light = 1 - 0.72 * np.linspace(0, 1, PANEL) ** 0.6
        image[-PANEL:] = (image[-PANEL:] * light[:, None, None]).astype(np.uint8)
    if steering is not None:
        lock_deg = UNKNOWN_LOCK_DEG if rig is None else rig.steering_deg
        _draw_wheel(image, (70, height - 54), 40, steering * lock_deg * WHEEL_RATIO)
        factor, form = (1.0, "{:+.2f}") if rig is None else (rig.steering_deg, "{:+.1f}°")
        angle = form.format(steering * factor + 0.0).replace("-", "\N{MINUS SIGN}")
        band = form.format(BAND * (spread or 0.0) * factor).replace("+", " ±")
        doubt = "" if spread is None else band
        texts += [
            (angle, 128, height - 57, 26, WHITE, "lm"),
            (f"STEERING{doubt}", 128, height - 26, 13, GREY, "lm"),
        ]
        _draw_steering_bar(image, (width // 2, height - 40), 150, steering, spread or 0.0)
        if recorded is not None:
            _mark_wheel(image, (70, height - 54), 47, recorded * lock_deg * WHEEL_RATIO, GREEN)
            angle = form.format(recorded * factor + 0.0).replace("-", "\N{MINUS SIGN}")
            lines.append(("RECORDED", angle, GREEN))
    if speed_mph is not None:
        texts += [
            (f"{speed_mph:.1f}", width - 84, height - 50, 38, WHITE, "rm"),
            ("mph", width - 76, height - 43, 17, GREY, "lm"),
        ]
    if throttle is not None:
        _draw_pedals(image, (width - 208, height - 20), 184, throttle)
    if autonomy is not None:
        colour = GREEN if autonomy >= 0.995 else AMBER if autonomy >= 0.9 else RED
        lines.append(("AUTONOMY", f"{autonomy:.1%}", colour))
    if cte_m is not None:
        side = "right" if cte_m > 0 else "left"
        line = "OFF CENTRE" if recorded is None else "OFF PATH"
        lines.append((line, f"{abs(cte_m):.2f} m {side}", WHITE))
    if time_s is not None and math.isfinite(time_s):
        clock = f"{int(time_s // 60)}:{time_s % 60:04.1f}"
        lines.append(("TIME" if lap is None else f"LAP {lap}", clock, WHITE))
    left, right = width - 288, width - 20
    boxes = [(left, 18, right, 32 + 30 * len(lines))] if lines else []
    for y, (label, text, colour) in zip(range(40, 40 + 30 * len(lines), 30), lines, strict=True):
        texts.append((label, left + 14, y, 13, GREY, "lm"))
        texts.append((text, right - 14, y, 20, colour, "rm"))
    if note:
        boxes.append((20, 18, 48 + int(_font(18).getlength(note)), 54))
        texts.append((note, 34, 36, 18, WHITE, "lm"))
    map_at = 20, 18 if not note else 66
    if road is not None and len(road) > 1:
        boxes.append((*map_at, map_at[0] + MAP, map_at[1] + MAP))
    drawn = Image.fromarray(image)
    blending, draw = ImageDraw.Draw(drawn, "RGBA"), ImageDraw.Draw(drawn)
    for box in boxes:
        blending.rounded_rectangle(box, 10, fill=(12, 16, 22, 140))
    if road is not None and len(road) > 1:
        _draw_map(draw, map_at, road, xy)
    for text, x, y, size, colour, anchor in texts:
        draw.text((x, y), text, fill=colour, font=_font(size), anchor=anchor)
    return np.array(drawn)


def _draw_map(
    draw: ImageDraw.ImageDraw, at: tuple[int, int], road: np.ndarray, xy: tuple | None
) -> None:
    """Draw the road into a square, north up, and a dot for the car."""
    low, high = road.min(0), road.max(0)
    scale = (MAP - 24) / max(float((high - low).max()), 1.0)
    middle = np.array(at) + MAP / 2

    def place(points: np.ndarray) -> np.ndarray:
        return np.asarray(middle + (points - (low + high) / 2) * scale * (1, -1))

    draw.line([tuple(one) for one in place(road).tolist()], fill=GREY, width=4, joint="curve")
    if xy is not None:
        x, y = place(np.array(xy)).tolist()
        draw.ellipse((x - 7, y - 7, x + 7, y + 7), fill=AMBER)


def _draw_wheel(image: np.ndarray, centre: tuple[int, int], radius: int, angle_deg: float) -> None:
    cv2.circle(image, centre, radius, WHITE, 6, cv2.LINE_AA)
    angle = np.radians(angle_deg)
    for spoke in (np.pi, 0, np.pi / 2):  # left, right, down
        way = np.array([np.cos(angle + spoke), np.sin(angle + spoke)])
        _line(image, centre + 9 * way, centre + (radius - 2) * way, WHITE, 6)
    cv2.circle(image, centre, 10, WHITE, -1, cv2.LINE_AA)
    _mark_wheel(image, centre, radius, angle_deg, AMBER)


def _mark_wheel(
    image: np.ndarray, centre: tuple[int, int], radius: int, angle_deg: float, colour: tuple
) -> None:
    """Draw a mark that is at the top of a straight wheel, as on a racing wheel."""
    cv2.ellipse(image, centre, (radius, radius), angle_deg - 90, -11, 11, colour, 6, cv2.LINE_AA)


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

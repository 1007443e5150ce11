"""Films of drives: the state drawn on camera frames, and the frames kept from a scored drive."""

import functools
import importlib.util
import math
from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from datamodules.formats.recording_writer import write_frame
from zoo.base.rig import Rig
from zoo.base.video import Film
from zoo.driving.drive_record import BAND, DriveRow
from zoo.driving.tally import autonomy

FILM_NAME, FRAMES = "film.mp4", "frames"
MOMENTS, APART_S = 10, 2.0
WIDTH = 640  # of a drawn frame; at 960 a film takes twice the bytes, and three times as long
WHEEL_RATIO = 6.0  # angle of the drawn steering wheel per angle of the front wheels
UNKNOWN_LOCK_DEG = 25.0  # drawn of a car of unknown rig
Colour = tuple[int, int, int]
WHITE, GREY, GREEN, RED, AMBER = (
    (255, 255, 255),
    (190, 196, 204),
    (92, 214, 130),
    (255, 92, 80),
    (255, 184, 64),
)
MOST_WAITING = 16  # frames that are not yet painted
MAP = 100  # side in pixels of the small map
PANEL = 70  # height in pixels of the darkened band for the instruments, over the car's bonnet
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
            least = min(self.moments, key=lambda moment: badness(moment[1]))
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
        rig: see `Overlay`.
        road: points of the road for a small map, float [N, 2], m; None draws no map.

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
        self.every, self.rig = max(1, round(speed)), rig
        self.road = None if road is None or len(road) < 2 else RoadMap(road)
        self.number = self.interventions = 0
        # The simulator draws the next frames meanwhile, without Python's lock.
        self.painter, self.painted = ThreadPoolExecutor(1), deque[Future[None]]()
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
        state = Overlay(
            row.steering,
            row.throttle,
            row.speed_mph,
            autonomy(self.interventions, row.time_s) if is_measured else None,
            row.cross_track_m,
            spread=row.spread,
            rig=self.rig,
            time_s=row.time_s,
            lap=lap,
            road=self.road,
            xy=xy,
        )
        self.painted.append(self.painter.submit(self._paint, frame.copy(), state))
        if len(self.painted) > MOST_WAITING:
            self.painted.popleft().result()

    def __exit__(self, *error: Any) -> None:
        """Complete the film.

        Raises:
            InputError: the film cannot be written.
        """
        self.painter.shutdown(cancel_futures=error[0] is not None)
        try:
            if error[0] is None:
                for painted in self.painted:
                    painted.result()
        finally:
            super().__exit__(*error)

    def _paint(self, frame: np.ndarray, state: "Overlay") -> None:
        self.add(draw_overlay(frame, state))


@dataclass(frozen=True)
class Overlay:
    """The state of a drive that is drawn into a frame; what is None or NaN is not drawn.

    Attributes:
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
        road: small map of the road.
        xy: position of the car on the map, m.
    """

    steering: float | None = None
    throttle: float | None = None
    speed_mph: float | None = None
    autonomy: float | None = None
    cte_m: float | None = None
    note: str | None = None
    spread: float | None = None
    rig: Rig | None = None
    recorded: float | None = None
    time_s: float | None = None
    lap: int | None = None
    road: "RoadMap | None" = None
    xy: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        """Replace numbers that are not finite by None."""
        for name, value in vars(self).items():
            if isinstance(value, float | np.floating) and not math.isfinite(value):
                object.__setattr__(self, name, None)


class RoadMap:
    """A small map, north up, whose line is drawn once: a film shows it in each frame.

    Args:
        road: points of the road, float [N, 2], m; two or more.
    """

    def __init__(self, road: np.ndarray) -> None:
        low, high = road.min(0), road.max(0)
        self.middle, self.scale = (low + high) / 2, (MAP - 16) / max(float((high - low).max()), 1.0)
        self.line = Image.new("1", (MAP, MAP))
        points = [tuple(point) for point in self._place(road).tolist()]
        ImageDraw.Draw(self.line).line(points, fill=1, width=3, joint="curve")

    def draw(self, image: Image.Image, at: tuple[int, int], xy: tuple | None) -> None:
        """Draw the road, and a dot for the car, into the square that begins at a pixel."""
        image.paste(GREY, at, self.line)
        if xy is not None:
            x, y = (self._place(np.array(xy)) + at).tolist()
            ImageDraw.Draw(image).ellipse((x - 5, y - 5, x + 5, y + 5), fill=AMBER)

    def _place(self, points: np.ndarray) -> np.ndarray:
        return np.asarray(MAP / 2 + (points - self.middle) * self.scale * (1, -1))


class Label(NamedTuple):
    """A text in a frame, and the point of the text that stands at x and y, as in Pillow."""

    text: str
    x: int
    y: int
    size: int
    colour: Colour
    anchor: str = "lm"


def draw_overlay(frame: np.ndarray, state: Overlay) -> np.ndarray:
    """Return an enlarged camera frame, uint8 [H, W, 3] RGB, with a drive's state drawn in.

    Returns:
        uint8 [640 H / W, 640, 3], RGB.
    """
    size = WIDTH, WIDTH * len(frame) // frame.shape[1]
    image = cv2.resize(frame, size, interpolation=cv2.INTER_CUBIC)
    labels, boxes = _draw_instruments(image, state), []
    if rows := _text_rows(state):
        boxes.append((WIDTH - 192, 12, WIDTH - 13, 21 + 20 * len(rows)))
    for number, (name, value, colour) in enumerate(rows):
        y = 27 + 20 * number
        labels.append(Label(name, WIDTH - 183, y, 9, GREY))
        labels.append(Label(value, WIDTH - 23, y, 13, colour, "rm"))
    if state.note:
        boxes.append((13, 12, 32 + int(film_font(12).getlength(state.note)), 36))
        labels.append(Label(state.note, 23, 24, 12, WHITE))
    corner = 13, 44 if state.note else 12
    if state.road is not None:
        boxes.append((*corner, corner[0] + MAP, corner[1] + MAP))
    drawn = Image.fromarray(image)
    blending = ImageDraw.Draw(drawn, "RGBA")
    for box in boxes:
        blending.rounded_rectangle(box, 7, fill=(12, 16, 22, 140))
    if state.road is not None:
        state.road.draw(drawn, corner, state.xy)
    draw = ImageDraw.Draw(drawn)
    for label in labels:
        point, font = (label.x, label.y), film_font(label.size)
        draw.text(point, label.text, fill=label.colour, font=font, anchor=label.anchor)
    return np.array(drawn)


def _draw_instruments(image: np.ndarray, state: Overlay) -> list[Label]:
    """Draw wheel, steering and pedals over the bonnet; return their texts."""
    height, labels = len(image), []
    if (state.steering, state.throttle, state.speed_mph) != (None, None, None):
        # Fade to black, so that text is readable on any road.
        light = 1 - 0.72 * np.linspace(0, 1, PANEL) ** 0.6
        image[-PANEL:] = (image[-PANEL:] * light[:, None, None]).astype(np.uint8)
    if state.steering is not None:
        wheel, spread = (47, height - 36), state.spread or 0.0
        turn_deg = WHEEL_RATIO * (UNKNOWN_LOCK_DEG if state.rig is None else state.rig.steering_deg)
        draw_wheel(image, wheel, 27, state.steering * turn_deg)
        _draw_steering_bar(image, (WIDTH // 2, height - 27), 100, state.steering, spread)
        if state.recorded is not None:
            mark_wheel(image, wheel, 31, state.recorded * turn_deg, GREEN)
        band = angle_text(BAND * spread, state.rig).replace("+", " ±")
        name = f"STEERING{'' if state.spread is None else band}"
        labels.append(Label(angle_text(state.steering, state.rig), 85, height - 38, 17, WHITE))
        labels.append(Label(name, 85, height - 17, 9, GREY))
    if state.speed_mph is not None:
        labels.append(Label(f"{state.speed_mph:.1f}", WIDTH - 56, height - 33, 25, WHITE, "rm"))
        labels.append(Label("mph", WIDTH - 51, height - 29, 11, GREY))
    if state.throttle is not None:
        _draw_pedals(image, (WIDTH - 139, height - 13), 123, state.throttle)
    return labels


def angle_text(steering: float, rig: Rig | None) -> str:
    """Return a steering in degrees of the wheels; as it is, for a car of unknown rig."""
    degrees = rig and f"{round(steering * rig.steering_deg, 1) + 0.0:+.1f}°"
    return (degrees or f"{round(steering, 2) + 0.0:+.2f}").replace("-", "\N{MINUS SIGN}")


def _text_rows(state: Overlay) -> list[tuple[str, str, Colour]]:
    """Return name, value and colour of each row at the top right."""
    rows = []
    if state.steering is not None and state.recorded is not None:
        rows.append(("RECORDED", angle_text(state.recorded, state.rig), GREEN))
    if state.autonomy is not None:
        colour = GREEN if state.autonomy >= 0.995 else AMBER if state.autonomy >= 0.9 else RED
        rows.append(("AUTONOMY", f"{state.autonomy:.1%}", colour))
    if state.cte_m is not None:
        name = "OFF CENTRE" if state.recorded is None else "OFF PATH"
        side = "right" if state.cte_m > 0 else "left"
        rows.append((name, f"{abs(state.cte_m):.2f} m {side}", WHITE))
    if state.time_s is not None:
        minutes, seconds = divmod(round(state.time_s, 1), 60)
        clock = f"{int(minutes)}:{seconds:04.1f}"
        rows.append(("TIME" if state.lap is None else f"LAP {state.lap}", clock, WHITE))
    return rows


def draw_wheel(
    image: np.ndarray,
    centre: tuple[int, int],
    radius: int,
    angle_deg: float,
    colour: Colour = AMBER,
) -> None:
    """Draw a steering wheel with a mark at its top, turned clockwise by an angle."""
    cv2.circle(image, centre, radius, WHITE, 4, cv2.LINE_AA)
    angle = np.radians(angle_deg)
    for spoke in (np.pi, 0, np.pi / 2):  # left, right, down
        way = np.array([np.cos(angle + spoke), np.sin(angle + spoke)])
        _line(image, centre + 6 * way, centre + (radius - 1) * way, WHITE, 4)
    cv2.circle(image, centre, 7, WHITE, -1, cv2.LINE_AA)
    mark_wheel(image, centre, radius, angle_deg, colour)


def mark_wheel(
    image: np.ndarray, centre: tuple[int, int], radius: int, angle_deg: float, colour: tuple
) -> None:
    """Draw a mark that is at the top of a straight wheel, as on a racing wheel."""
    cv2.ellipse(image, centre, (radius, radius), angle_deg - 90, -11, 11, colour, 4, cv2.LINE_AA)


def _draw_steering_bar(
    image: np.ndarray, centre: tuple[int, int], half: int, steering: float, spread: float
) -> None:
    """Draw a bar from the middle to the steering, with its band; its ends are full lock."""
    middle = np.array(centre, float)
    if spread > 0:
        first, last = np.clip((steering - BAND * spread, steering + BAND * spread), -1, 1)
        left, right = round(centre[0] + half * first), round(centre[0] + half * last)
        patch = image[centre[1] - 9 : centre[1] + 10, left : right + 1]
        patch[:] = (0.6 * patch + 0.4 * np.array(AMBER)).astype(np.uint8)
    _line(image, middle - (half, 0), middle + (half, 0), (110, 116, 124), 3)
    if abs(steering) > 0.004:
        _line(image, middle, middle + (half * float(np.clip(steering, -1, 1)), 0), AMBER, 5)
    _line(image, middle - (0, 6), middle + (0, 6), WHITE, 1)


def _draw_pedals(image: np.ndarray, start: tuple[int, int], length: int, throttle: float) -> None:
    """Draw a bar: green for throttle, red for the brake."""
    begin = np.array(start, float)
    _line(image, begin, begin + (length, 0), (110, 116, 124), 4)
    share = min(abs(throttle), 1.0)
    if share > 0.005:
        _line(image, begin, begin + (length * share, 0), GREEN if throttle > 0 else RED, 4)


def _line(
    image: np.ndarray, start: np.ndarray, end: np.ndarray, colour: tuple, thickness: int
) -> None:
    first, last = (np.round(np.array([start, end]) * (1 << _SUBPIXEL))).astype(int).tolist()
    cv2.line(image, first, last, colour, thickness, cv2.LINE_AA, _SUBPIXEL)


@functools.lru_cache(16)
def film_font(size: int) -> ImageFont.FreeTypeFont:
    """Return the font of all films in a size."""
    # matplotlib's own font makes films look the same on every machine. find_spec avoids importing
    # matplotlib, which takes 0.5 s. The font's digits are equally wide.
    spec = importlib.util.find_spec("matplotlib")
    assert spec is not None
    assert spec.origin is not None
    package = Path(spec.origin).parent
    name = "DejaVuSans-Bold.ttf" if size >= 13 else "DejaVuSans.ttf"
    return ImageFont.truetype(str(package / "mpl-data" / "fonts" / "ttf" / name), size)

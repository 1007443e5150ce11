"""A film of several pilots over one recording: their wheels, and how far each is off over time."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from PIL import Image, ImageDraw

from zoo.base.rig import Rig
from zoo.driving.drive_film import (
    AMBER,
    GREEN,
    GREY,
    UNKNOWN_LOCK_DEG,
    WHEEL_RATIO,
    WHITE,
    WIDTH,
    Colour,
    angle_text,
    draw_wheel,
    film_font,
    mark_wheel,
)

BLUE, ROSE = (96, 170, 255), (255, 130, 190)
COLOURS: Sequence[Colour] = (AMBER, BLUE, ROSE, WHITE)  # of the pilots, in their order
STRIP, SHOWN_FRAMES = 140, 300  # height of the panel below the frame; frames of the graph
RADIUS, GRAPH_TOP, GRAPH_HALF, EDGE = 23, 65, 32, 51  # of a wheel, and of the graph, pixels
CHARACTER = 5.5  # width of a small letter, pixels
FULL = 0.5  # difference at the graph's edge; half of the full steering
BACKGROUND, LINE = (16, 20, 27), (70, 76, 86)


@dataclass(frozen=True)
class Pilots:
    """The pilots of a film, and their steering so far.

    Attributes:
        names: names of the pilots, up to four.
        rig: car whose wheels' angle is shown; None shows the steering itself.
        steering: recorded steering of each frame so far, then each pilot's, -1..1.
    """

    names: Sequence[str]
    rig: Rig | None
    steering: list[list[float]]

    def draw(self, frame: np.ndarray) -> np.ndarray:
        """Return an enlarged frame with a panel for the last frame, uint8 [H, 640, 3] RGB."""
        size = WIDTH, WIDTH * len(frame) // frame.shape[1]
        picture = cv2.resize(frame, size, interpolation=cv2.INTER_CUBIC)
        panel = np.full((STRIP, WIDTH, 3), BACKGROUND, np.uint8)
        turn_deg = WHEEL_RATIO * (self.rig.steering_deg if self.rig else UNKNOWN_LOCK_DEG)
        table, values = np.array(self.steering), self.steering[-1]
        columns, differences = WIDTH // len(values), table[:, 1:] - table[:, :1]
        means = np.abs(differences).mean(axis=0)
        texts = []
        for number, value in enumerate(values):
            colour = COLOURS[number - 1] if number else GREEN
            name = self.names[number - 1] if number else "recorded"
            centre = columns * number + 36, 32
            left = centre[0] + 35
            name = name[-int((columns * (number + 1) - left) / CHARACTER) :]
            draw_wheel(panel, centre, RADIUS, value * turn_deg, colour)
            if number:
                mark_wheel(panel, centre, RADIUS + 5, values[0] * turn_deg, GREEN)
                texts.append((left, 50, f"off by {means[number - 1]:.3f}", 9, GREY))
            texts.append((left, 20, angle_text(value, self.rig), 16, colour))
            texts.append((left, 37, name, 9, GREY))
        middle = GRAPH_TOP + GRAPH_HALF
        for height in (-GRAPH_HALF, 0, GRAPH_HALF):
            cv2.line(panel, (EDGE, middle + height), (WIDTH - 8, middle + height), LINE, 1)
            side = "left" if height < 0 else "right"
            share = f"{FULL:g} {side}" if height else "0"
            texts.append((8, middle + height, share, 9, GREY))
        shown = differences[-SHOWN_FRAMES:]
        places = np.linspace(EDGE, WIDTH - 8, SHOWN_FRAMES)[-len(shown) :]
        heights = middle + GRAPH_HALF * np.clip(shown / FULL, -1, 1)
        for curve, colour in zip(heights.T, COLOURS, strict=False):
            points = np.stack([places, curve], axis=1).round().astype(np.int32)
            cv2.polylines(panel, [points], False, colour, 2, cv2.LINE_AA)
        drawn = Image.fromarray(np.concatenate([picture, panel]))
        draw = ImageDraw.Draw(drawn)
        for x, y, text, font, colour in texts:
            draw.text((x, size[1] + y), text, fill=colour, font=film_font(font), anchor="lm")
        return np.array(drawn)

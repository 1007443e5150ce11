"""An augmentation that paints lines on the road that mean nothing."""

import os

os.environ.setdefault("NO_ALBUMENTATIONS_UPDATE", "1")  # it asks the network for its own version

import albumentations
import cv2
import numpy as np

from datamodules.ground import FOCAL_PX, depth_of, row_of
from datamodules.image import FRAME_HEIGHT, FRAME_WIDTH

NEAREST_M, FARTHEST_M = 1.5, 45.0
WHITE, YELLOW = (235, 235, 225), (215, 190, 60)


class Lines(albumentations.ImageOnlyTransform):
    """Paint lines along the road, white or yellow, whole or dashed, at any place across it.

    A recording of one track teaches that a line is the edge of the road. On another it may be the
    middle, or a seam. Lines that change nothing about the steering teach to look at the road
    itself: domain randomisation as in Tobin et al. 2017 (arXiv:1703.06907).

    Args:
        count: at most so many lines.
        aside_m: the farthest to either side of the car.
        width_m: the range of a line's width.
        turned_deg: the largest angle to the car's own direction.
        p: the probability of a sample to be changed.

    Attributes:
        crop: rows off the top and the bottom of the recording's 160; `DrivingData` sets its view's.
    """

    def __init__(
        self,
        count: int = 2,
        aside_m: float = 3.0,
        width_m: tuple[float, float] = (0.08, 0.3),
        turned_deg: float = 4.0,
        p: float = 0.5,
    ) -> None:
        super().__init__(p=p)
        self.count, self.aside_m = count, aside_m
        self.width_m, self.turned_deg = tuple(width_m), turned_deg
        self.crop = (0, 0)

    def get_params(self) -> dict:
        return self.draw_batch((1, 1, 1, 3), np.random.default_rng(self.py_random.getrandbits(64)))[
            0
        ]

    def apply(self, img: np.ndarray, lines: list[tuple], **_: object) -> np.ndarray:
        painted = img.copy()
        self.change_one(painted, lines)
        return painted

    def draw_batch(self, shape: tuple[int, ...], rng: np.random.Generator) -> list[dict]:
        """`apply`'s arguments for each of a batch of `shape`."""
        drawn = []
        for _ in range(shape[0]):
            lines = []
            for _ in range(rng.integers(1, self.count + 1)):
                aside, width = rng.uniform(-self.aside_m, self.aside_m), rng.uniform(*self.width_m)
                turned = np.radians(rng.uniform(-self.turned_deg, self.turned_deg))
                dash = rng.uniform(1.0, 5.0) if rng.random() < 0.5 else FARTHEST_M
                paint = np.array(WHITE if rng.random() < 0.5 else YELLOW) * rng.uniform(0.5, 1.05)
                if shape[3] == 1:  # grey, or a saturation: any
                    paint = rng.uniform(40, 255, 1)
                lines.append((aside, width, turned, dash, tuple(paint.clip(0, 255).tolist())))
            drawn.append({"lines": lines})
        return drawn

    def change_one(self, picture: np.ndarray, lines: list[tuple]) -> None:
        """`apply`, in place."""
        for aside, width, turned, dash, paint in lines:
            begins = np.arange(NEAREST_M, FARTHEST_M, 2 * dash)
            for begin in begins:
                ahead = np.geomspace(begin, min(begin + dash, FARTHEST_M), 6)
                middle = aside + np.tan(turned) * ahead
                corners = [
                    self._pixels(picture, ahead, middle + half) for half in (-width / 2, width / 2)
                ]
                outline = np.concatenate([corners[0], corners[1][::-1]])
                cv2.fillPoly(picture, [outline], paint, cv2.LINE_AA, shift=4)

    def _pixels(self, picture: np.ndarray, ahead: np.ndarray, aside: np.ndarray) -> np.ndarray:
        """Ground points in sixteenths of a view's pixels, int32 [N, 2] (column, row)."""
        height, width = picture.shape[:2]
        top, bottom = self.crop
        rows = (row_of(ahead) + 0.5 - top) * height / (FRAME_HEIGHT - top - bottom) - 0.5
        columns = FRAME_WIDTH / 2 + FOCAL_PX * aside / depth_of(ahead)
        pixels = np.stack([columns * width / FRAME_WIDTH - 0.5, rows], 1)
        return (16 * pixels).astype(np.int32)

"""An augmentation that bends the road, and adds the steering for that bend.

A recording holds only the bends of its own track; a network has to steer through others. From the
camera's geometry follows how a flat road looks when it bends more, or the other way.
"""

import os

os.environ.setdefault("NO_ALBUMENTATIONS_UPDATE", "1")  # disables its version check online

import albumentations
import cv2
import numpy as np

from datamodules.image import FRAME_HEIGHT, FRAME_WIDTH
from zoo.base.rig import UDACITY

CAMERA = UDACITY.cameras["center"]
FARTHEST_M = 60.0


def metres_ahead(rows: np.ndarray) -> np.ndarray:
    """Return the distance from the camera to the ground that rows show, metres, float64.

    Rows are of the recording's 160. The distance is at most 60 m, also above the horizon.
    """
    below = np.arctan((rows - (FRAME_HEIGHT - 1) / 2) / CAMERA.focal_px)
    below = below + np.radians(CAMERA.pitch_down_deg)
    return CAMERA.up_m / np.tan(np.maximum(below, np.arctan(CAMERA.up_m / FARTHEST_M)))


def depth_of(ahead_m: np.ndarray) -> np.ndarray:
    """Return the depth of ground along the lens's axis, metres.

    A metre to the side is `focal_px / depth` columns of the recording's 320.
    """
    pitch = np.radians(CAMERA.pitch_down_deg)
    return ahead_m * np.cos(pitch) + CAMERA.up_m * np.sin(pitch)


def added_steering(curvature: np.ndarray | float, begin: np.ndarray | float) -> np.ndarray:
    """Return the steering that a bend adds, by its curvature and its start ahead of the car."""
    # A command arrives a frame later, and the car needs some metres to turn.
    due = np.interp(begin, [1.0, 3.0], [1.0, 0.0])
    return due * np.degrees(np.arctan(UDACITY.wheelbase_m * curvature)) / UDACITY.steering_deg


class Bend(albumentations.ImageOnlyTransform):
    """Bend the road ahead as if it lay on flat ground, and steer accordingly.

    A ground point s metres beyond the bend's start moves sideways by curvature * s^2 / 2, and
    beyond the bend's end along its tangent. Image rows above the horizon move with the farthest
    ground. A bend that has started adds the steering angle of its radius, arctan(wheelbase *
    curvature); one further ahead adds less, and none from 3 m on: a network learns to steer when it
    reaches the bend. It is the counterpart, for bends, of the shifted and rotated views of Bojarski
    et al. 2016 ("End to End Learning for Self-Driving Cars").

    Args:
        curvature: largest curvature added to either side, 1/m.
        length_m: range of the bend's length, metres.
        ahead_m: largest distance from the car's origin to a bend's start, metres.
        begun: share of bends that start at the rear axle, 0..1; the others start up to `ahead_m`.
        p: probability that a sample is changed, 0..1.

    Attributes:
        crop: rows off the top and the bottom of the recording's 160; set by `DrivingData`.
    """

    def __init__(
        self,
        curvature: float = 0.12,
        length_m: tuple[float, float] = (8.0, 30.0),
        ahead_m: float = 10.0,
        begun: float = 0.5,
        p: float = 0.5,
    ) -> None:
        super().__init__(p=p)
        self.curvature, self.length_m, self.ahead_m = curvature, tuple(length_m), ahead_m
        self.begun = begun
        self.crop = (0, 0)

    @property
    def targets(self) -> dict:
        """Return functions by target: images as usual, and `steering`."""
        return {**super().targets, "steering": self.apply_to_steering}

    def get_params(self) -> dict:
        """Draw a bend."""
        return self.draw_batch((1,), np.random.default_rng(self.py_random.getrandbits(64)))[0]

    def apply(
        self, img: np.ndarray, curvature: float, begin: float, length: float, **_: object
    ) -> np.ndarray:
        """Return the bent image."""
        height, width = img.shape[:2]
        aside = self.columns_aside(height, curvature, begin, length) * width / FRAME_WIDTH
        source = np.arange(width, dtype=np.float32) - aside[:, None].astype(np.float32)
        rows = np.repeat(np.arange(height, dtype=np.float32)[:, None], width, axis=1)
        bent = cv2.remap(img, source, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101)
        return bent.reshape(img.shape)  # OpenCV drops a last axis of one

    def apply_to_steering(
        self, steering: float, curvature: float, begin: float, **_: object
    ) -> float:
        """Return the corrected steering, -1..1."""
        return float(np.clip(steering + added_steering(curvature, begin), -1, 1))

    def columns_aside(
        self, height: int, curvature: float, begin: float, length: float
    ) -> np.ndarray:
        """Return how far each of a view's rows moves to the right, float64 [height].

        The unit is a column of the recording's 320.
        """
        top, bottom = self.crop
        rows = top + (np.arange(height) + 0.5) * (FRAME_HEIGHT - top - bottom) / height - 0.5
        ahead = metres_ahead(rows)  # rows above the horizon move with the farthest ground
        along = np.maximum(ahead + CAMERA.ahead_m - begin, 0)
        bent = np.minimum(along, length)
        metres = curvature * (bent**2 / 2 + bent * (along - bent))
        return np.clip(
            CAMERA.focal_px * metres / depth_of(ahead), -FRAME_WIDTH / 2, FRAME_WIDTH / 2
        )

    def draw_batch(self, shape: tuple[int, ...], rng: np.random.Generator) -> list[dict]:
        """Return `apply`'s arguments for each image of a batch of `shape`."""
        count = shape[0]
        curvature = rng.uniform(-self.curvature, self.curvature, count)
        shortest, longest = self.length_m
        length = rng.uniform(shortest, longest, count)
        ahead = rng.uniform(-UDACITY.rear_axle_m, self.ahead_m, count)
        begin = np.where(rng.random(count) < self.begun, -UDACITY.rear_axle_m, ahead)
        return [
            {"curvature": one, "begin": start, "length": metres}
            for one, start, metres in zip(curvature, begin, length, strict=True)
        ]

    def change_one(self, image: np.ndarray, curvature: float, begin: float, length: float) -> None:
        """Change one image in place, as `apply`."""
        image[:] = self.apply(image, curvature, begin, length)

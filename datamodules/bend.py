"""An augmentation that bends the road, with the steering that the bend takes.

A recording holds only the bends of its own track; a network has to steer round others. What a flat
road would look like if it turned more, or the other way, follows from the camera alone.
"""

import os

os.environ.setdefault("NO_ALBUMENTATIONS_UPDATE", "1")  # it asks the network for its own version

import albumentations
import cv2
import numpy as np

from datamodules.ground import (
    CAMERA_AHEAD_M,
    FOCAL_PX,
    MAX_STEERING_DEG,
    REAR_AXLE_M,
    WHEELBASE_M,
    depth_of,
    metres_ahead,
)
from datamodules.image import FRAME_HEIGHT, FRAME_WIDTH


class Bend(albumentations.ImageOnlyTransform):
    """Bend the road ahead as if it lay on flat ground, and steer accordingly.

    A ground point s metres beyond the bend's begin moves sideways by curvature * s^2 / 2, and
    beyond the bend's end straight on; what stands above the horizon moves with the farthest ground.
    A bend that has begun adds the steering angle of its radius, arctan(wheelbase * curvature); one
    that begins further ahead adds less, from 3 m on none: a network learns to turn in when it is
    there. It is the counterpart, for bends, of the shifted and rotated views of Bojarski et al.
    2016 ("End to End Learning for Self-Driving Cars").

    Args:
        curvature: the largest, of either side, added to the road's own; 1/m.
        length_m: the range of the bend's length.
        ahead_m: how far ahead of the car's origin a bend may begin, at most.
        begun: the share of bends that begin at the rear axle; the others, anywhere up to there.
        p: the probability of a sample to be changed.

    Attributes:
        crop: rows off the top and the bottom of the recording's 160; `DrivingData` sets its view's.
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
        return {**super().targets, "steering": self.apply_to_steering}

    def get_params(self) -> dict:
        return self.draw_batch((1,), np.random.default_rng(self.py_random.getrandbits(64)))[0]

    def apply(
        self, img: np.ndarray, curvature: float, begin: float, length: float, **_: object
    ) -> np.ndarray:
        height, width = img.shape[:2]
        aside = self.columns_aside(height, curvature, begin, length) * width / FRAME_WIDTH
        source = np.arange(width, dtype=np.float32) - aside[:, None].astype(np.float32)
        rows = np.repeat(np.arange(height, dtype=np.float32)[:, None], width, axis=1)
        bent = cv2.remap(img, source, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101)
        return bent.reshape(img.shape)  # OpenCV drops a last axis of one

    def apply_to_steering(
        self, steering: float, curvature: float, begin: float, **_: object
    ) -> float:
        # A command takes a frame to come, and the car some way to turn.
        due = np.interp(begin, [1.0, 3.0], [1.0, 0.0])
        added = due * np.degrees(np.arctan(WHEELBASE_M * curvature)) / MAX_STEERING_DEG
        return float(np.clip(steering + added, -1, 1))

    def columns_aside(
        self, height: int, curvature: float, begin: float, length: float
    ) -> np.ndarray:
        """How far each of a view's rows moves to the right, float64 [height], in columns of the
        recording's 320."""
        top, bottom = self.crop
        rows = top + (np.arange(height) + 0.5) * (FRAME_HEIGHT - top - bottom) / height - 0.5
        ahead = metres_ahead(rows)  # what is above the horizon moves with the farthest
        along = np.maximum(ahead + CAMERA_AHEAD_M - begin, 0)
        bent = np.minimum(along, length)
        metres = curvature * (bent**2 / 2 + bent * (along - bent))
        return np.clip(FOCAL_PX * metres / depth_of(ahead), -FRAME_WIDTH / 2, FRAME_WIDTH / 2)

    def draw_batch(self, shape: tuple[int, ...], rng: np.random.Generator) -> list[dict]:
        """`apply`'s arguments for each of a batch of `shape`."""
        count = shape[0]
        curvature = rng.uniform(-self.curvature, self.curvature, count)
        shortest, longest = self.length_m
        length = rng.uniform(shortest, longest, count)
        ahead = rng.uniform(-REAR_AXLE_M, self.ahead_m, count)
        begin = np.where(rng.random(count) < self.begun, -REAR_AXLE_M, ahead)
        return [
            {"curvature": one, "begin": start, "length": metres}
            for one, start, metres in zip(curvature, begin, length, strict=True)
        ]

    def change_one(
        self, picture: np.ndarray, curvature: float, begin: float, length: float
    ) -> None:
        """`apply`, in place."""
        picture[:] = self.apply(picture, curvature, begin, length)

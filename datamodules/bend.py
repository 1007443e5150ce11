"""An augmentation that bends the road, and adds the steering for that bend.

A recording holds only the bends of its own track; a network has to steer through others. From the
camera's geometry follows how a flat road looks when it bends more, or the other way.
"""

import cv2
import numpy as np
import torch
from torch import Tensor

from datamodules.augment import Change
from datamodules.device_augment import moved
from datamodules.view import FRAME
from zoo.base.errors import InputError
from zoo.base.rig import Camera, Rig

FARTHEST_M = 60.0


def metres_ahead(rows: np.ndarray, camera: Camera) -> np.ndarray:
    """Return the distance from the camera to the ground that rows show, metres, float64.

    Rows are of the camera's frame. The distance is at most 60 m, also above the horizon.
    """
    below = np.arctan((rows - (camera.size[1] - 1) / 2) / camera.focal_px)
    below = below + np.radians(camera.pitch_down_deg)
    return camera.up_m / np.tan(np.maximum(below, np.arctan(camera.up_m / FARTHEST_M)))


def depth_of(ahead_m: np.ndarray, camera: Camera) -> np.ndarray:
    """Return the depth of ground along the lens's axis, metres.

    A metre to the side is `focal_px / depth` columns of the camera's frame.
    """
    pitch = np.radians(camera.pitch_down_deg)
    return ahead_m * np.cos(pitch) + camera.up_m * np.sin(pitch)


def added_steering(
    curvature: np.ndarray | float, begin: np.ndarray | float, rig: Rig
) -> np.ndarray:
    """Return the steering that a bend adds, by its curvature and its start ahead of the car."""
    # A command arrives a frame later, and the car needs some metres to turn.
    due = np.interp(begin, [1.0, 3.0], [1.0, 0.0])
    return due * rig.steering_of(curvature)


class Bend(Change):
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
        crop: the view's; set by `fit`.
        rig: car whose centre camera sees the road; set by `fit`.
    """

    zeros_change_nothing = True
    crop: tuple[int, int]
    rig: Rig

    def __init__(
        self,
        curvature: float = 0.12,
        length_m: tuple[float, float] = (8.0, 30.0),
        ahead_m: float = 10.0,
        begun: float = 0.5,
        p: float = 0.5,
    ) -> None:
        self.curvature, self.length_m, self.ahead_m = curvature, tuple(length_m), ahead_m
        self.begun, self.p = begun, p

    def fit(self, crop: tuple[int, int], rig: Rig | None) -> None:
        """Take a view's crop and a recording's rig.

        Raises:
            InputError: the rig is unknown.
        """
        if rig is None:
            raise InputError(
                "augment: bend depends on the car's camera and wheelbase; name them with "
                "data.rig=FILE, or leave bend out"
            )
        self.crop, self.rig = crop, rig

    def draw(self, shape: tuple[int, ...], rng: np.random.Generator) -> np.ndarray:
        """Return the added steering, and each row's move to the right in columns of the view."""
        count = shape[0]
        curvature = rng.uniform(-self.curvature, self.curvature, count)
        shortest, longest = self.length_m
        length = rng.uniform(shortest, longest, count)
        ahead = rng.uniform(-self.rig.rear_axle_m, self.ahead_m, count)
        begin = np.where(rng.random(count) < self.begun, -self.rig.rear_axle_m, ahead)
        aside = self.columns_aside(shape[1], curvature, begin, length)
        added = added_steering(curvature, begin, self.rig)
        return np.column_stack([added, aside * shape[2] / self.rig.cameras["center"].size[0]])

    def columns_aside(
        self, height: int, curvature: np.ndarray, begin: np.ndarray, length: np.ndarray
    ) -> np.ndarray:
        """Return how far each of a view's rows moves to the right in bends, float64 [n, height].

        The unit is a column of the camera's frame.
        """
        camera, (top, bottom) = self.rig.cameras["center"], self.crop
        rows = top + (np.arange(height) + 0.5) * (FRAME[0] - top - bottom) / height
        rows = rows * (camera.size[1] / FRAME[0]) - 0.5
        ahead = metres_ahead(rows, camera)  # rows above the horizon move with the farthest ground
        along = np.maximum(ahead + camera.ahead_m - begin[:, None], 0)
        bent = np.minimum(along, length[:, None])
        metres = curvature[:, None] * (bent**2 / 2 + bent * (along - bent))
        most = camera.size[0] / 2
        return np.clip(camera.focal_px * metres / depth_of(ahead, camera), -most, most)

    def change_one(self, image: np.ndarray, drawn: np.ndarray) -> None:
        """Bend an image in place."""
        height, width = image.shape[:2]
        source = np.arange(width, dtype=np.float32) - drawn[1:, None].astype(np.float32)
        rows = np.repeat(np.arange(height, dtype=np.float32)[:, None], width, axis=1)
        bent = cv2.remap(image, source, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101)
        image[:] = bent.reshape(image.shape)  # OpenCV drops a last axis of one

    def change_all(self, images: Tensor, drawn: Tensor) -> Tensor:
        """Return bent images."""
        return moved(images, drawn[:, 1:], torch.zeros_like(drawn[:, 0]), beyond="reflection")

    def steer(self, steering: np.ndarray, drawn: np.ndarray) -> np.ndarray:
        """Return the steering with that of the bend."""
        return np.clip(steering + drawn[:, :1], -1, 1)

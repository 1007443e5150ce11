"""Augmentations that bend the road or move the car, and steer for what the image then shows.

A recording holds only the bends of its own track, from its driver's line; a network has to steer
through other bends, and back to the line. From the camera's geometry follows how a flat road looks
when it bends more, or from another pose.
"""

from typing import Annotated

import cv2
import numpy as np
import torch
from pydantic import Field
from torch import Tensor

from datamodules.augment import Change
from datamodules.balance import Least0, Share
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
    return np.interp(begin, [1.0, 3.0], [1.0, 0.0]) * rig.steering_of(curvature)


def metres_aside(
    ahead_m: np.ndarray | float, curvature: np.ndarray, begin: np.ndarray, length: np.ndarray
) -> np.ndarray:
    """Return how far a bend moves the road to the right, metres.

    Args:
        ahead_m: distance ahead of the car's origin, metres.
        curvature: curvature of the bend, 1/m, right positive.
        begin: its start ahead of the car's origin, metres.
        length: its length, metres; the road goes on along the tangent.
    """
    along = np.maximum(ahead_m - begin, 0)
    bent = np.minimum(along, length)
    return curvature * (bent**2 / 2 + bent * (along - bent))


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
    values = 1  # first columns of `draw`, which `steer` reads; the others are moves of rows
    crop: tuple[int, int]
    rig: Rig

    def __init__(
        self,
        curvature: Least0 = 0.12,
        length_m: tuple[Least0, Least0] = (8.0, 30.0),
        ahead_m: Least0 = 10.0,
        begun: Share = 0.5,
        p: Share = 0.5,
    ) -> None:
        self.curvature, self.length_m, self.ahead_m = curvature, sorted(length_m), ahead_m
        self.begun, self.p = begun, p

    def fit(self, crop: tuple[int, int], rig: Rig | None) -> None:
        """Take a view's crop and a recording's rig.

        Raises:
            InputError: the rig is unknown, or the recordings' rigs differ.
        """
        if rig is None:
            name = type(self).__name__.lower()
            raise InputError(
                f"augment: {name} needs recordings of one car with a known camera and wheelbase; "
                f"name it with data.rig=FILE, or leave {name} out"
            )
        self.crop, self.rig = crop, rig

    def draw(self, shape: tuple[int, ...], rng: np.random.Generator) -> np.ndarray:
        """Return values of `steer`, and each row's move to the right in columns of the view."""
        count = shape[0]
        curvature = rng.uniform(-self.curvature, self.curvature, count)
        length = rng.uniform(self.length_m[0], self.length_m[1], count)
        ahead = rng.uniform(-self.rig.rear_axle_m, self.ahead_m, count)
        begin = np.where(rng.random(count) < self.begun, -self.rig.rear_axle_m, ahead)
        bend = curvature[:, None], begin[:, None], length[:, None]
        values, moves = self.changed(bend, shape[1], rng)
        return np.column_stack([*values, moves * shape[2] / self.rig.cameras["center"].size[0]])

    def changed(
        self, bend: tuple[np.ndarray, ...], height: int, rng: np.random.Generator
    ) -> tuple[tuple[np.ndarray, ...], np.ndarray]:
        """Return what `steer` needs, and the moves of a view's rows for `columns_aside`.

        Args:
            bend: curvature, start and length of each sample's bend, float64 [n, 1] each.
            height: number of rows of the view.
            rng: source of further random values.
        """
        curvature, begin, _ = bend
        return (added_steering(curvature, begin, self.rig),), self.columns_aside(height, bend)

    def columns_aside(
        self,
        height: int,
        bend: tuple[np.ndarray, ...],
        aside_m: np.ndarray | float = 0.0,
        turn_rad: np.ndarray | float = 0.0,
    ) -> np.ndarray:
        """Return how far each of a view's rows moves to the right, float64 [n, height].

        The unit is a column of the camera's frame.

        Args:
            height: number of rows of the view.
            bend: see `metres_aside`.
            aside_m: distance by which the car is moved to the right, metres.
            turn_rad: angle by which it is turned to the right about its rear axle.
        """
        camera, (top, bottom) = self.rig.cameras["center"], self.crop
        rows = top + (np.arange(height) + 0.5) * (FRAME[0] - top - bottom) / height
        rows = rows * (camera.size[1] / FRAME[0]) - 0.5
        ahead = metres_ahead(rows, camera)  # rows above the horizon move with the farthest ground
        metres = metres_aside(ahead + camera.ahead_m, *bend)
        metres = metres - aside_m - (camera.ahead_m + self.rig.rear_axle_m) * np.sin(turn_rad)
        columns = camera.focal_px * (metres / depth_of(ahead, camera) - np.tan(turn_rad))
        most = camera.size[0] / 2
        return np.clip(columns, -most, most)

    def change_one(self, image: np.ndarray, drawn: np.ndarray) -> None:
        """Bend an image in place."""
        height, width = image.shape[:2]
        source = np.arange(width, dtype=np.float32) - drawn[self.values :, None].astype(np.float32)
        rows = np.repeat(np.arange(height, dtype=np.float32)[:, None], width, axis=1)
        bent = cv2.remap(image, source, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101)
        image[:] = bent.reshape(image.shape)  # OpenCV drops a last axis of one

    def change_all(self, images: Tensor, drawn: Tensor) -> Tensor:
        """Return bent images."""
        moves, down = drawn[:, self.values :], torch.zeros_like(drawn[:, 0])
        return moved(images, moves, down, beyond="reflection")

    def steer(self, steering: np.ndarray, drawn: np.ndarray) -> np.ndarray:
        """Return the steering with that of the bend."""
        return steering + drawn[:, :1]


class Pose(Bend):
    """Bend the road, move the car to the side, turn it, and steer to the changed line.

    One label stands for all three changes: the steering of the circle from the turned rear axle to
    the changed line, `pursuit_m` ahead. This is pure pursuit (Coulter 1992, "Implementation of the
    Pure Pursuit Path Tracking Algorithm", CMU-RI-TR-92-01). The recorded steering is the circle of
    the unchanged line: where nothing is changed, the label is the recorded one.

    Args:
        curvature, length_m, ahead_m, begun: of the bend, see `Bend`.
        aside_m: largest distance by which the car is moved to either side, metres.
        turn_deg: largest angle by which it is turned to either side about its rear axle, degrees.
        pursuit_m: metres from the rear axle to the point of the line that it steers to, 1 or more.
        p: probability that a sample is changed, 0..1.
    """

    values = 3

    def __init__(
        self,
        curvature: Least0 = 0.16,
        length_m: tuple[Least0, Least0] = (8.0, 30.0),
        ahead_m: Least0 = 10.0,
        begun: Share = 0.5,
        aside_m: Least0 = 1.2,
        turn_deg: Least0 = 8.0,
        pursuit_m: Annotated[float, Field(ge=1)] = 4.3,
        p: Share = 0.7,
    ) -> None:
        super().__init__(curvature, length_m, ahead_m, begun, p)
        self.aside_m, self.turn_deg, self.pursuit_m = aside_m, turn_deg, pursuit_m

    def changed(
        self, bend: tuple[np.ndarray, ...], height: int, rng: np.random.Generator
    ) -> tuple[tuple[np.ndarray, ...], np.ndarray]:
        """Return the bend at the point pursued, displacement and turn; and the moves of rows."""
        size = bend[0].shape
        aside_m = rng.uniform(-self.aside_m, self.aside_m, size)
        turn_rad = np.radians(rng.uniform(-self.turn_deg, self.turn_deg, size))
        bent_m = metres_aside(self.pursuit_m - self.rig.rear_axle_m, *bend)
        return (bent_m, aside_m, turn_rad), self.columns_aside(height, bend, aside_m, turn_rad)

    def steer(self, steering: np.ndarray, drawn: np.ndarray) -> np.ndarray:
        """Return the steering to the changed line, from the changed pose."""
        bent_m, aside_m, turn_rad = (drawn[:, number, None] for number in range(self.values))
        # Of the unchanged line, a circle through the rear axle: ahead of it, and to its right.
        right_m = self.rig.curvature(steering) * self.pursuit_m**2 / 2
        ahead_m = np.sqrt(np.maximum(self.pursuit_m**2 - right_m**2, 0))
        right_m = right_m + bent_m - aside_m
        seen_ahead_m = ahead_m * np.cos(turn_rad) + right_m * np.sin(turn_rad)
        seen_right_m = right_m * np.cos(turn_rad) - ahead_m * np.sin(turn_rad)
        return self.rig.steering_of(2 * seen_right_m / (seen_ahead_m**2 + seen_right_m**2))

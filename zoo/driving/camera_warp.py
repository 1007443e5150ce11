"""Warping of recorded frames to the view of a shifted and turned car.

As in Bojarski et al. 2016 ("End to End Learning for Self-Driving Cars"), every pixel below the
horizon is taken as level ground, and every pixel above it as infinitely far away. Upright objects,
such as trees and barriers, are sheared when the car is shifted. A turn without a shift is exact.
"""

from collections.abc import Callable

import cv2
import numpy as np

from zoo.base.rig import Camera, Rig
from zoo.simulator.scenery.frame_effects import own_car_cover
from zoo.simulator.udacity_car import camera_matrix

BONNET_EDGE_PX = 5  # width of the bonnet's edge that JPEG blurs


class Warp:
    """Warp that computes the centre camera's frame in another pose of the car.

    The frame of the nearest camera is warped. Pixels that its bonnet or border hides come from the
    next nearest camera. Pixels that no camera saw repeat the nearest camera's border. The bonnet is
    that of the centre frame.

    Args:
        rig: cameras of the car.
        size: height and width of the frames. Where they differ from the rig's, the recorded frames
            were stretched.

    >>> from zoo.base.rig import UDACITY
    >>> frames = {"center": np.full((160, 320, 3), 90, np.uint8)}
    >>> int(Warp(UDACITY, (160, 320))(frames.__getitem__, ["center"], 0.5, 0.02).mean())
    90
    """

    def __init__(self, rig: Rig, size: tuple[int, int]) -> None:
        self._rig, (self._height, self._width) = rig, size
        v, u = np.mgrid[0 : self._height, 0 : self._width].astype(np.float32) + 0.5
        across, down = self._focal_px("center")
        right, up = u - self._width / 2, (self._height / 2 - v) * (across / down)
        rays = np.stack([right, up, np.full_like(u, across)]).reshape(3, -1)
        below = np.minimum(_matrix(rig.cameras["center"])[1] @ rays, 0)
        # Ray of each pixel, and its part below the horizon, which no turn of the car changes.
        self._rays = np.concatenate([rays, below[None]]).astype(np.float32)
        self._hidden = {
            name: _own_car(camera, size).ravel() for name, camera in rig.cameras.items()
        }
        self._bonnet = np.flatnonzero(self._hidden["center"])
        # Only the ground is filled in from other cameras: above the horizon all see the same.
        self._is_ground = (below < 0) & ~self._hidden["center"]

    def __call__(
        self,
        frame_of: Callable[[str], np.ndarray],
        cameras: list[str],
        right_m: float,
        heading_rad: float,
    ) -> np.ndarray:
        """Return the frame of a shifted and turned car, uint8 [H, W, 3] RGB.

        Args:
            frame_of: function of a camera's name that returns its recorded frame, uint8 [H, W, 3]
                RGB.
            cameras: names of the recorded cameras, with `center`.
            right_m: shift to the right of the recorded car, in metres.
            heading_rad: turn to the right of the recorded car, in radians.
        """
        if right_m == heading_rad == 0:
            return frame_of("center")
        at, rig = self._place(right_m, heading_rad), self._rig
        nearest, *others = sorted(cameras, key=lambda name: abs(rig.cameras[name].right_m - at[0]))
        maps = self.maps(nearest, right_m, heading_rad)
        flat = self._remap(frame_of(nearest), maps)
        missing = np.flatnonzero(self._unseen(nearest, maps) & self._is_ground)
        for camera in others:
            if not len(missing):
                break
            maps = self.maps(camera, right_m, heading_rad, missing)
            seen = ~self._unseen(camera, maps)
            if seen.any():
                here = tuple(axis[seen] for axis in maps)
                flat[missing[seen]] = self._remap(frame_of(camera), here)
                missing = missing[~seen]
        flat[self._bonnet] = frame_of("center").reshape(-1, 3)[self._bonnet]
        return flat.reshape(self._height, self._width, 3)

    def maps(
        self,
        camera: str,
        right_m: float,
        heading_rad: float,
        pixels: np.ndarray | slice = slice(None),
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the positions of pixels in a recorded camera's frame: x and y, float32.

        The ray r of the moved camera and the ray S^T (T R r - t down(r) / height) of the recorded
        camera meet the same point of the ground, or of infinity. R is the rotation of the centre
        camera, S that of the recorded one, T the car's turn, t the vector between the cameras, and
        height the moved camera's height. down(r) is the vertical part of R r where it is negative,
        and 0 above the horizon.

        Args:
            camera: name of the recorded camera.
            right_m: shift to the right of the recorded car, in metres.
            heading_rad: turn to the right of the recorded car, in radians.
            pixels: flat indices of the moved camera's pixels.
        """
        center, recorded = self._rig.cameras["center"], self._rig.cameras[camera]
        turn = camera_matrix(0, np.degrees(heading_rad), 0)
        way = self._place(right_m, heading_rad) - _place_m(recorded)
        turned = _matrix(recorded).T @ turn @ _matrix(center)
        moved = -_matrix(recorded).T @ way / center.up_m
        rays = self._rays[:, pixels]
        # Not `@`: BLAS sums in another order on another processor, which moves pixels.
        x, y, ahead = (
            a * rays[0] + b * rays[1] + c * rays[2] + d * rays[3]
            for a, b, c, d in np.column_stack([turned, moved]).astype(np.float32)
        )
        across, down = self._focal_px(camera)
        ahead = np.maximum(ahead, np.float32(1e-3))
        x *= np.float32(across) / ahead
        y *= -np.float32(down) / ahead
        x += np.float32(self._width / 2 - 0.5)
        y += np.float32(self._height / 2 - 0.5)
        return x, y

    def _focal_px(self, camera: str) -> tuple[float, float]:
        """Return a camera's focal length across and down the frame."""
        width, height = self._rig.cameras[camera].size
        focal = self._rig.cameras[camera].focal_px
        return focal * (self._width / width), focal * (self._height / height)

    def _place(self, right_m: float, heading_rad: float) -> np.ndarray:
        """Return the moved centre camera's metres right, up and ahead of the recorded car."""
        turn = camera_matrix(0, np.degrees(heading_rad), 0)
        centre: np.ndarray = turn @ _place_m(self._rig.cameras["center"])
        return centre + (right_m, 0.0, 0.0)

    def _unseen(self, camera: str, maps: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        """Return the pixels that the camera's bonnet or borders hide, bool [N]."""
        x, y = (np.rint(axis).astype(np.int32) for axis in maps)
        outside = (x < 0) | (x >= self._width) | (y < 0) | (y >= self._height)
        at = np.where(outside, 0, y * self._width + x)
        unseen: np.ndarray = outside | self._hidden[camera][at]
        return unseen

    def _remap(self, frame: np.ndarray, maps: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        """Return the frame's colours at N positions, uint8 [N, 3]."""
        # OpenCV accepts at most 32767 columns.
        wide = self._width if len(maps[0]) % self._width == 0 else 1
        x, y = (axis.reshape(-1, wide) for axis in maps)
        pixels = cv2.remap(frame, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return pixels.reshape(-1, 3)


def _place_m(camera: Camera) -> np.ndarray:
    return np.array([camera.right_m, camera.up_m, camera.ahead_m])


def _matrix(camera: Camera) -> np.ndarray:
    return camera_matrix(camera.pitch_down_deg, camera.yaw_right_deg, camera.roll_deg)


def _own_car(camera: Camera, size: tuple[int, int]) -> np.ndarray:
    """Return where a camera sees its own car, bool [H, W]."""
    cover = cv2.resize(own_car_cover(camera), size[::-1], interpolation=cv2.INTER_NEAREST)
    return cv2.dilate(np.uint8(cover > 0), np.ones((BONNET_EDGE_PX, BONNET_EDGE_PX), np.uint8)) > 0

"""Warping of recorded frames to the view of a shifted and turned car.

As in Bojarski et al. 2016 ("End to End Learning for Self-Driving Cars"), every pixel below the
horizon is taken as level ground, and every pixel above it as infinitely far away. Upright objects,
such as trees and barriers, are sheared when the car is shifted. A turn without a shift is exact.
"""

from collections.abc import Callable

import cv2
import numpy as np

from simulator.rig import (
    CAMERA_POSITIONS,
    CAMERAS,
    FOCAL_PX,
    FRAME_HEIGHT,
    FRAME_WIDTH,
    PITCH_DOWN_DEG,
    ROLL_DEG,
    YAW_RIGHT_DEG,
    camera_matrix,
)
from simulator.scenery.frame_effects import bonnet_image

BONNET_EDGE_PX = 5  # width of the bonnet's edge that JPEG blurs


class Warp:
    """Warp that computes the centre camera's frame in another pose of the car.

    The frame of the nearest camera is warped. Pixels that its bonnet or border hides come from the
    next nearest camera. Pixels that no camera saw repeat the nearest camera's border. The bonnet is
    that of the centre frame.

    >>> frames = {"center": np.full((160, 320, 3), 90, np.uint8)}
    >>> int(Warp()(frames.__getitem__, ["center"], 0.5, 0.02).mean())
    90
    """

    def __init__(self) -> None:
        v, u = np.mgrid[0:FRAME_HEIGHT, 0:FRAME_WIDTH].astype(np.float32) + 0.5
        rays = np.stack([(u - FRAME_WIDTH / 2), (FRAME_HEIGHT / 2 - v), np.full_like(u, FOCAL_PX)])
        self._looks = camera_matrix(PITCH_DOWN_DEG, YAW_RIGHT_DEG, ROLL_DEG)
        rays = rays.reshape(3, -1)
        down = np.minimum(self._looks[1] @ rays, 0)
        # Ray of each pixel, and its part below the horizon, which no turn of the car changes.
        self._rays = np.concatenate([rays, down[None]]).astype(np.float32)
        covers = {camera: bonnet_image(camera)[1] for camera in CAMERAS}
        around = np.ones((BONNET_EDGE_PX, BONNET_EDGE_PX), np.uint8)
        self._hidden = {
            camera: cv2.dilate(np.uint8(cover[..., 0] > 0), around).ravel() > 0
            for camera, cover in covers.items()
        }
        self._bonnet = np.flatnonzero(self._hidden["center"])
        # Only the ground is filled in from other cameras: above the horizon all see the same.
        self._is_ground = (down < 0) & ~self._hidden["center"]

    def __call__(
        self,
        frame_of: Callable[[str], np.ndarray],
        cameras: list[str],
        right_m: float,
        heading_rad: float,
    ) -> np.ndarray:
        """Return the frame of a shifted and turned car, uint8 [160, 320, 3] RGB.

        Args:
            frame_of: function of a camera's name that returns its recorded frame, uint8
                [160, 320, 3] RGB.
            cameras: names of the recorded cameras, with `center`.
            right_m: shift to the right of the recorded car, in metres.
            heading_rad: turn to the right of the recorded car, in radians.
        """
        if right_m == heading_rad == 0:
            return frame_of("center")
        at = camera_place(right_m, heading_rad)
        nearest, *others = sorted(cameras, key=lambda one: abs(CAMERA_POSITIONS[one][0] - at[0]))
        maps = self.maps(nearest, right_m, heading_rad)
        image = _remap(frame_of(nearest), maps).reshape(FRAME_HEIGHT, FRAME_WIDTH, 3)
        flat = image.reshape(-1, 3)
        missing = np.flatnonzero(self._unseen(nearest, maps) & self._is_ground)
        for camera in others:
            if not len(missing):
                break
            maps = self.maps(camera, right_m, heading_rad, missing)
            seen = ~self._unseen(camera, maps)
            if seen.any():
                here = tuple(one[seen] for one in maps)
                flat[missing[seen]] = _remap(frame_of(camera), here)
                missing = missing[~seen]
        flat[self._bonnet] = frame_of("center").reshape(-1, 3)[self._bonnet]
        return image

    def maps(
        self,
        camera: str,
        right_m: float,
        heading_rad: float,
        pixels: np.ndarray | slice = slice(None),
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the positions of pixels in a recorded camera's frame: x and y, float32.

        The ray r of the moved camera and the ray R^T (T R r - t down(r) / height) of the recorded
        camera meet the same point of the ground, or of infinity. R is the cameras' rotation, T the
        car's turn, t the vector between the cameras, and height the recorded camera's height.
        down(r) is the vertical part of R r where it is negative, and 0 above the horizon.

        Args:
            camera: name of the recorded camera.
            right_m: shift to the right of the recorded car, in metres.
            heading_rad: turn to the right of the recorded car, in radians.
            pixels: flat indices of the moved camera's pixels.
        """
        turn = camera_matrix(0, np.degrees(heading_rad), 0)
        way = camera_place(right_m, heading_rad) - CAMERA_POSITIONS[camera]
        turned = self._looks.T @ turn @ self._looks
        moved = -self._looks.T @ way / CAMERA_POSITIONS[camera][1]
        x, y, ahead = np.column_stack([turned, moved]).astype(np.float32) @ self._rays[:, pixels]
        scale = np.float32(FOCAL_PX) / np.maximum(ahead, np.float32(1e-3))
        x *= scale
        y *= -scale
        x += np.float32(FRAME_WIDTH / 2 - 0.5)
        y += np.float32(FRAME_HEIGHT / 2 - 0.5)
        return x, y

    def _unseen(self, camera: str, maps: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        """Return the pixels that the camera's bonnet or borders hide, bool [N]."""
        x, y = (np.rint(one).astype(np.int32) for one in maps)
        outside = (x < 0) | (x >= FRAME_WIDTH) | (y < 0) | (y >= FRAME_HEIGHT)
        at = np.where(outside, 0, y * FRAME_WIDTH + x)
        return outside | self._hidden[camera][at]


def camera_place(right_m: float, heading_rad: float) -> np.ndarray:
    """Return the moved centre camera's position: metres right, up and ahead of the recorded car."""
    own = camera_matrix(0, np.degrees(heading_rad), 0) @ CAMERA_POSITIONS["center"]
    return own + (right_m, 0.0, 0.0)


def _remap(frame: np.ndarray, maps: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Return the frame's colours at N positions, uint8 [N, 3]."""
    # OpenCV accepts at most 32767 columns.
    wide = FRAME_WIDTH if len(maps[0]) % FRAME_WIDTH == 0 else 1
    x, y = (one.reshape(-1, wide) for one in maps)
    found = cv2.remap(frame, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return found.reshape(-1, 3)

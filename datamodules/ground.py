"""Geometry of image rows on flat ground, for augmentations of roads.

The dimensions are those of the original simulator's centre camera and car; a test compares them
with the embedded simulator's.
"""

import numpy as np

from datamodules.image import FRAME_HEIGHT

CAMERA_HEIGHT_M, CAMERA_AHEAD_M = 1.2, 1.0  # ahead of the car's origin
PITCH_DOWN_DEG = 9.5
FOCAL_PX = FRAME_HEIGHT / 2 / np.tan(np.radians(30.0))
WHEELBASE_M, REAR_AXLE_M = 2.87, 1.60  # the rear axle is behind the origin
FARTHEST_M = 60.0


def metres_ahead(rows: np.ndarray) -> np.ndarray:
    """Return the distance from the camera to the ground that rows show, metres, float64.

    Rows are of the recording's 160. The distance is at most 60 m, also above the horizon.
    """
    below = np.arctan((rows - (FRAME_HEIGHT - 1) / 2) / FOCAL_PX) + np.radians(PITCH_DOWN_DEG)
    return CAMERA_HEIGHT_M / np.tan(np.maximum(below, np.arctan(CAMERA_HEIGHT_M / FARTHEST_M)))


def depth_of(ahead_m: np.ndarray) -> np.ndarray:
    """Return the depth of ground along the lens's axis, metres.

    A metre to the side is `FOCAL_PX / depth` columns of the recording's 320.
    """
    pitch = np.radians(PITCH_DOWN_DEG)
    return ahead_m * np.cos(pitch) + CAMERA_HEIGHT_M * np.sin(pitch)

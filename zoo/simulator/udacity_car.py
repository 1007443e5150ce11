"""The original car of Udacity's simulator: its rig's numbers by name, and its mass and speed."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from zoo.base.rig import UDACITY

CAMERAS = tuple(UDACITY.cameras)
CENTER = UDACITY.cameras["center"]
FRAME_WIDTH, FRAME_HEIGHT = CENTER.size
VERTICAL_FOV_DEG, NEAR_M = CENTER.vertical_fov_deg, 0.3
PIXELS = (8, 1024)  # smallest and largest width and height of a camera
FOV_DEG = (1.0, 170.0)

FRONT_AXLE_M, REAR_AXLE_M = UDACITY.front_axle_m, UDACITY.rear_axle_m
WHEELBASE_M, MAX_STEERING_DEG = UDACITY.wheelbase_m, UDACITY.steering_deg
WHEEL_TRACK_M = 2.0
MASS_KG = 1000.0
TOP_SPEED_MPH = 30.0
PHYSICS_STEP_S = 0.02


@dataclass(frozen=True)
class CameraOffset:
    """A displacement of the cameras, in metres and degrees, and another angle of view.

    Args:
        fov_deg: degrees by which the angle of view from the top to the bottom of a frame is wider.
    """

    right_m: float = 0.0
    up_m: float = 0.0
    pitch_deg: float = 0.0
    yaw_deg: float = 0.0
    roll_deg: float = 0.0
    fov_deg: float = 0.0


@lru_cache
def camera_matrix(pitch_down_deg: float, yaw_right_deg: float, roll_deg: float) -> np.ndarray:
    """Return the rotation, float64 [3, 3], from a camera's axes (right, up, ahead) to the car's.

    The order is Unity's: roll about the lens, then pitch, then yaw. A positive roll lifts the right
    side.
    """
    pitch, yaw, roll = np.radians([pitch_down_deg, yaw_right_deg, roll_deg])
    about_up = np.array([[np.cos(yaw), 0, np.sin(yaw)], [0, 1, 0], [-np.sin(yaw), 0, np.cos(yaw)]])
    about_right = np.array(
        [[1, 0, 0], [0, np.cos(pitch), -np.sin(pitch)], [0, np.sin(pitch), np.cos(pitch)]]
    )
    about_ahead = np.array(
        [[np.cos(roll), -np.sin(roll), 0], [np.sin(roll), np.cos(roll), 0], [0, 0, 1]]
    )
    matrix = about_up @ about_right @ about_ahead
    matrix.flags.writeable = False  # the cache returns the same array for each frame
    return matrix

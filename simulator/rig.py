"""Cameras and measures of the original car, in metres and degrees, from its simulator."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

FRAME_WIDTH, FRAME_HEIGHT = 320, 160
VERTICAL_FOV_DEG = 60.0
NEAR_M = 0.3
FOCAL_PX = FRAME_HEIGHT / 2 / np.tan(np.radians(VERTICAL_FOV_DEG / 2))

CAMERAS = ("center", "left", "right")
# x right, y up and z ahead of the car's origin on the ground.
CAMERA_POSITIONS = {
    "center": (0.0, 1.2, 1.0),
    "left": (-0.806, 1.2, 0.984),
    "right": (0.825, 1.2, 0.999),
}
PITCH_DOWN_DEG, YAW_RIGHT_DEG, ROLL_DEG = 9.5, 0.72, 1.2

FRONT_AXLE_M, REAR_AXLE_M = 1.27, 1.60
WHEELBASE_M = FRONT_AXLE_M + REAR_AXLE_M
WHEEL_TRACK_M = 2.0
MASS_KG = 1000.0
MAX_STEERING_DEG = 25.0
TOP_SPEED_MPH = 30.0
MPS_PER_MPH = 0.44704
PHYSICS_STEP_S = 0.02


@dataclass(frozen=True)
class CameraOffset:
    """A displacement of the cameras, in metres and degrees."""

    right_m: float = 0.0
    up_m: float = 0.0
    pitch_deg: float = 0.0
    yaw_deg: float = 0.0
    roll_deg: float = 0.0


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

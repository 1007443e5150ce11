"""Rigs: the cameras and the steering of a car, which give a recording's numbers their meaning."""

import math
from dataclasses import dataclass
from typing import Any

MPS_PER_MPH = 0.44704


@dataclass(frozen=True)
class Camera:
    """A camera on a car.

    Attributes:
        right_m, up_m, ahead_m: place, from the car's origin on the ground between the axles.
        size: width and height of its frames, pixels.
        vertical_fov_deg: angle of view from the top to the bottom of a frame.
        pitch_down_deg, yaw_right_deg, roll_deg: direction; a positive roll lifts the right side.
    """

    right_m: float
    up_m: float
    ahead_m: float
    size: tuple[int, int] = (320, 160)
    vertical_fov_deg: float = 60.0
    pitch_down_deg: float = 0.0
    yaw_right_deg: float = 0.0
    roll_deg: float = 0.0

    @property
    def focal_px(self) -> float:
        """Return the focal length in pixels."""
        return self.size[1] / 2 / math.tan(math.radians(self.vertical_fov_deg / 2))


@dataclass(frozen=True)
class Rig:
    """The cameras and the steering of a car.

    Attributes:
        name: name of the rig.
        cameras: cameras by name, the centre one first.
        front_axle_m, rear_axle_m: distances of the axles from the car's origin.
        steering_deg: angle of the front wheels at a steering of 1.
        right_positive: whether a positive steering turns right in the source of a recording;
            in a `Recording` it always does.
        guesses: names of numbers that no source states.
    """

    name: str
    cameras: dict[str, Camera]
    front_axle_m: float
    rear_axle_m: float
    steering_deg: float
    right_positive: bool = True
    guesses: tuple[str, ...] = ()

    @property
    def wheelbase_m(self) -> float:
        """Return the distance between the axles."""
        return self.front_axle_m + self.rear_axle_m

    def curvature(self, steering: Any) -> Any:
        """Return the curvature of the rear axle's path by the bicycle model, 1/m, right positive.

        Args:
            steering: steering -1..1, right positive; a float or an array.

        >>> round(float(1 / UDACITY.curvature(1.0)), 2)
        6.15
        """
        import numpy as np  # slow import

        return np.tan(np.radians(steering * self.steering_deg)) / self.wheelbase_m

    def steering_of(self, curvature: Any) -> Any:
        """Return the steering of a curvature, the inverse of `curvature`; beyond -1..1 unclipped.

        >>> float(UDACITY.steering_of(UDACITY.curvature(0.5)).round(9))
        0.5
        """
        import numpy as np  # slow import

        return np.degrees(np.arctan(self.wheelbase_m * curvature)) / self.steering_deg


def _udacity_camera(right_m: float, ahead_m: float) -> Camera:
    return Camera(right_m, 1.2, ahead_m, pitch_down_deg=9.5, yaw_right_deg=0.72, roll_deg=1.2)


# Measured on the original simulator, as the embedded one has it.
UDACITY = Rig(
    name="udacity",
    cameras={
        "center": _udacity_camera(0.0, 1.0),
        "left": _udacity_camera(-0.806, 0.984),
        "right": _udacity_camera(0.825, 0.999),
    },
    front_axle_m=1.27,
    rear_axle_m=1.60,
    steering_deg=25.0,
)


def single_camera_rig(
    name: str,
    camera: Camera,
    wheelbase_m: float,
    steering_deg: float,
    guesses: tuple[str, ...] = (),
) -> Rig:
    """Return the rig of a car whose origin is midway between its axles."""
    half = wheelbase_m / 2
    return Rig(name, {"center": camera}, half, half, steering_deg, guesses=guesses)

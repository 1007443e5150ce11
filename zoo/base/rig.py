"""Rigs: the cameras and the steering of a car, which give a recording's numbers their meaning."""

import math
from dataclasses import dataclass, replace
from typing import Any

from zoo.base.errors import UsageError

MPS_PER_MPH = 0.44704
Outline = tuple[tuple[float, float], ...]  # x, y in pixels of a frame
CURVATURE = "curvature_per_m"  # in a checkpoint's facts on its recording, see `SteeringLabel`


@dataclass(frozen=True)
class Camera:
    """A camera on a car.

    Attributes:
        right_m, up_m, ahead_m: place, from the car's origin on the ground between the axles.
        size: width and height of its frames, pixels.
        vertical_fov_deg: angle of view from the top to the bottom of a frame.
        pitch_down_deg, yaw_right_deg, roll_deg: direction; a positive roll lifts the right side.
        own_car: outlines of the car's own parts in the frames, such as a bonnet.
    """

    right_m: float
    up_m: float
    ahead_m: float
    size: tuple[int, int] = (320, 160)
    vertical_fov_deg: float = 60.0
    pitch_down_deg: float = 0.0
    yaw_right_deg: float = 0.0
    roll_deg: float = 0.0
    own_car: tuple[Outline, ...] = ()

    def changed(self, **values: Any) -> "Camera":
        """Return the camera with other values, in whose frames the car's own parts are unknown."""
        other = replace(self, **values)
        return self if other == self else replace(other, own_car=())

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
        guesses: names of numbers that no source states.
    """

    name: str
    cameras: dict[str, Camera]
    front_axle_m: float
    rear_axle_m: float
    steering_deg: float
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
        """Return the steering of a curvature, the inverse of `curvature`; it can be beyond -1..1.

        >>> float(UDACITY.steering_of(UDACITY.curvature(0.5)).round(9))
        0.5
        """
        import numpy as np  # slow import

        return np.degrees(np.arctan(self.wheelbase_m * curvature)) / self.steering_deg


@dataclass(frozen=True)
class SteeringLabel:
    """What a label, and a network's output, of -1..1 says of a car's steering.

    Attributes:
        curvature_per_m: curvature of the path at a label of 1, in 1/m; None if the label is the
            steering itself, so that each conversion is the identity.
    """

    curvature_per_m: float | None = None

    @property
    def is_steering(self) -> bool:
        """Return whether the label is the steering itself."""
        return self.curvature_per_m is None

    def of(self, steering: Any, rig: Rig) -> Any:
        """Return the label of a car's steering, floats or arrays."""
        scale = self.curvature_per_m
        return steering if scale is None else rig.curvature(steering) / scale

    def curvature(self, label: Any, rig: Rig) -> Any:
        """Return the curvature of a label, 1/m."""
        scale = self.curvature_per_m
        return rig.curvature(label) if scale is None else label * scale

    def steering(self, label: Any, rig: Rig | None) -> Any:
        """Return the steering, -1..1, with which a car drives a label, floats or arrays.

        Raises:
            UsageError: the label is a curvature, and the driven car is unknown.
        """
        if self.curvature_per_m is None:
            return label
        if rig is None:
            raise UsageError(
                "this network was trained with data.label=curvature, and the rig of the driven car "
                "is unknown; name it in rig.yaml in the recording's folder, or train with "
                "data.label=steering"
            )
        return rig.steering_of(label * self.curvature_per_m).clip(-1, 1)


STEERING = SteeringLabel()


# Outlines of the car's own parts, from back to front, measured on the median of 80 of the
# original's frames: x,y in pixels of 320 x 160.
_OWN_CAR = {
    "center": (
        "36,160 45,155.5 67,150 88,146 105,143 117,139.5 130,137.5 172,137.5 185,140.5 "
        "200,144 215,146.5 238,151 264,160",
        "60,160 85,154 100,151 118,146 140,143.7 180,144.5 200,148 220,153 240,160",
        "91,160 117,153.5 133,151.5 150,150.5 185,151.7 218,160",
        "99,160 121,153.8 150,151.6 185,152.8 215,160",
    ),
    "left": (
        "185,160 187,154.5 195,149.5 207,144.5 222,143 240,141 255,139 270,137.5 295,137.5 "
        "320,140 320,160",
        "255,139 270,137.5 295,137.5 320,140 320,145 270,142",
        "186,160 188,154.5 197,149.5 200,155 200,160",
        "198,149 207,144.5 222,143.5 217,149 213,153 206,153",
        "303,160 304,154.5 310,152 320,151 320,160",
    ),
    "right": (
        "0,135 35,135 48,137.5 65,140.5 82,143 100,143 110,147.5 120,151 124,160 0,160",
        "0,135 35,135 55,141 30,139 0,142",
        "110,148.5 120,151 124,160 111,160",
        "86,143 105,145.5 109,150 103,157.5 94,151",
        "0,145 10,147.5 9,160 0,160",
    ),
}


def _outline(text: str) -> Outline:
    return tuple((float(x), float(y)) for x, y in (corner.split(",") for corner in text.split()))


# Measured on the original simulator, as the embedded one has it.
UDACITY = Rig(
    name="udacity",
    cameras={
        name: Camera(
            *(right_m, 1.2, ahead_m),
            pitch_down_deg=9.5,
            yaw_right_deg=0.72,
            roll_deg=1.2,
            own_car=tuple(map(_outline, _OWN_CAR[name])),
        )
        for name, right_m, ahead_m in (
            ("center", 0.0, 1.0),
            ("left", -0.806, 0.984),
            ("right", 0.825, 0.999),
        )
    },
    front_axle_m=1.27,
    rear_axle_m=1.60,
    steering_deg=25.0,
)


def centred(rig: Rig) -> Rig:
    """Return a rig with the car's origin midway between its axles, as a rig's file has it."""
    half = rig.wheelbase_m / 2
    ahead_m = rig.rear_axle_m - half
    cameras = {
        name: replace(camera, ahead_m=camera.ahead_m + ahead_m)
        for name, camera in rig.cameras.items()
    }
    return replace(rig, cameras=cameras, front_axle_m=half, rear_axle_m=half)


def donkey_sim(camera: Camera | None = None) -> Rig:
    """Return the car of `drivezoo simulator serve`, whose clients may set another camera."""
    usual = UDACITY.cameras["center"].changed(size=(160, 120), yaw_right_deg=0.0, roll_deg=0.0)
    cameras = {"center": camera or usual}
    return replace(UDACITY, name="donkey_sim", cameras=cameras, steering_deg=16.0)


# The outputs of Donkeycar's networks of one image: linear and inferred, and in bins, or linear
# before version 2.2 (`donkeycar/parts/keras.py`).
DONKEYCAR_OUTPUTS = (["n_outputs0", "n_outputs1"], ["n_outputs0"], ["angle_out", "throttle_out"])
# Rigs by the names that `data.rig=` takes.
RIGS = {"udacity": UDACITY, "donkey_sim": centred(donkey_sim())}
RIG_KEYS = " or ".join(f"data.rig={name}" for name in RIGS)


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

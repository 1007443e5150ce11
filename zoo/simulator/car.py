"""The car: a single-track ("bicycle") model whose tyres can slip, stepped every 0.02 s.

The model is from Rajamani, *Vehicle Dynamics and Control* (2012), ch. 2, with Pacejka's magic
formula for the tyres. Measures are the original car's (`udacity_car`). Drive and reverse force come
from the speeds of a recording of the original: 0 to 20 mph in 1.9 s, backwards at 1.25 m/s2.
The code uses plain floats and `math`, because numpy's scalars make a step seven times slower.
"""

import math
from dataclasses import dataclass

from zoo.base.rig import MPS_PER_MPH
from zoo.simulator import udacity_car as rig

DRIVE_N = 5400.0  # 2000 Nm at the wheels
REVERSE_N = 1300.0
DRAG_PER_S = 0.1
BRAKE_MPS2 = 9.0  # 20,000 Nm lock the wheels, so the grip is the limit
DOWNFORCE_N_PER_MPS = 100.0
YAW_INERTIA_KG_M2 = 1500.0
REVERSE_BELOW_MPH = 5.0
GRAVITY_MPS2 = 9.81
# Below this speed slip angles are undefined, and the wheels roll without slip.
ROLLING_BELOW_MPS = 3.0
TYRE_STIFFNESS, TYRE_SHAPE = 10.0, 1.4


@dataclass(frozen=True)
class Surface:
    """The ground under the wheels: friction coefficient and rolling resistance in m/s2."""

    grip: float
    resistance_mps2: float


ROAD = Surface(grip=1.0, resistance_mps2=0.05)
OFF_ROAD = Surface(grip=0.6, resistance_mps2=2.5)


class Car:
    """Position (x east, y north, metres), heading (radians from east) and motion of the car.

    The origin is the rig's, between the axles. `steering` (right positive) and `throttle`, -1..1,
    are the commands in effect.

    Args:
        reverses: whether a throttle below 0 reverses below 5 mph, as in the original; otherwise it
            brakes until the car stands.
    """

    def __init__(self, reverses: bool = True) -> None:
        self.reverses = reverses
        self.place(0.0, 0.0, 0.0)

    def place(self, x: float, y: float, heading: float, speed_mph: float = 0.0) -> None:
        """Put the car at a place, rolling straight ahead at a speed."""
        self.x, self.y, self.heading = float(x), float(y), float(heading)
        self.ahead_mps, self.left_mps, self.yaw_rate = float(speed_mph) * MPS_PER_MPH, 0.0, 0.0
        self.steering = self.throttle = 0.0

    @property
    def speed_mph(self) -> float:
        """Return the speed in any direction; never negative, as in the original's telemetry."""
        return math.hypot(self.ahead_mps, self.left_mps) / MPS_PER_MPH

    def step(self, steering: float, throttle: float, grade: float, surface: Surface) -> None:
        """Advance by 0.02 s.

        Args:
            steering: steering command, clamped to -1..1, right positive.
            throttle: throttle command, clamped to -1..1; below 0 it brakes or reverses.
            grade: rise of the road ahead, per metre.
            surface: surface under the wheels.
        """
        self.steering, self.throttle = clamp(steering), clamp(throttle)
        pull = self._pull_mps2(float(grade), surface)
        # Left is positive for angles in the plane, right for commands.
        wheel = -math.radians(rig.MAX_STEERING_DEG) * self.steering
        if abs(self.ahead_mps) < ROLLING_BELOW_MPS:
            self._roll(wheel, pull)
        else:
            self._slip(wheel, pull, surface)
        speed = self.speed_mph
        if speed > rig.TOP_SPEED_MPH:
            self.ahead_mps *= rig.TOP_SPEED_MPH / speed
            self.left_mps *= rig.TOP_SPEED_MPH / speed
        cos, sin = math.cos(self.heading), math.sin(self.heading)
        self.x += (self.ahead_mps * cos - self.left_mps * sin) * rig.PHYSICS_STEP_S
        self.y += (self.ahead_mps * sin + self.left_mps * cos) * rig.PHYSICS_STEP_S
        self.heading += self.yaw_rate * rig.PHYSICS_STEP_S

    def _pull_mps2(self, grade: float, surface: Surface) -> float:
        """Return the acceleration along the car by engine, brakes, drag, slope and rolling."""
        pull = -DRAG_PER_S * self.ahead_mps - GRAVITY_MPS2 * grade / math.hypot(1, grade)
        resistance = surface.resistance_mps2
        if self.throttle >= 0:
            pull += self.throttle * min(DRIVE_N / rig.MASS_KG, surface.grip * GRAVITY_MPS2)
        elif self.reverses and self.ahead_mps < REVERSE_BELOW_MPH * MPS_PER_MPH:
            pull += self.throttle * REVERSE_N / rig.MASS_KG
        else:
            resistance -= self.throttle * BRAKE_MPS2 * surface.grip
        # Friction stops a car and holds it, but never reverses its motion.
        after = self.ahead_mps + pull * rig.PHYSICS_STEP_S
        slowed = math.copysign(max(abs(after) - resistance * rig.PHYSICS_STEP_S, 0.0), after)
        return (slowed - self.ahead_mps) / rig.PHYSICS_STEP_S

    def _roll(self, wheel: float, pull: float) -> None:
        """Apply wheels that roll without slip, at low speed."""
        self.ahead_mps += pull * rig.PHYSICS_STEP_S
        self.yaw_rate = self.ahead_mps * math.tan(wheel) / rig.WHEELBASE_M
        self.left_mps = self.yaw_rate * rig.REAR_AXLE_M

    def _slip(self, wheel: float, pull: float, surface: Surface) -> None:
        """Apply the tyres' side forces, which grow with the slip angle up to the grip."""
        ahead = self.ahead_mps
        down = rig.MASS_KG * GRAVITY_MPS2 + DOWNFORCE_N_PER_MPS * abs(ahead)
        front_slip = math.copysign(wheel, wheel * ahead) - math.atan2(
            self.left_mps + rig.FRONT_AXLE_M * self.yaw_rate, abs(ahead)
        )
        rear_slip = -math.atan2(self.left_mps - rig.REAR_AXLE_M * self.yaw_rate, abs(ahead))
        front = _tyre_force(front_slip, down * rig.REAR_AXLE_M / rig.WHEELBASE_M * surface.grip)
        rear = _tyre_force(rear_slip, down * rig.FRONT_AXLE_M / rig.WHEELBASE_M * surface.grip)
        across = (front * math.cos(wheel) + rear) / rig.MASS_KG - self.yaw_rate * ahead
        turn = (
            rig.FRONT_AXLE_M * front * math.cos(wheel) - rig.REAR_AXLE_M * rear
        ) / YAW_INERTIA_KG_M2
        self.ahead_mps += (
            pull + self.yaw_rate * self.left_mps - front * math.sin(wheel) / rig.MASS_KG
        ) * rig.PHYSICS_STEP_S
        self.left_mps += across * rig.PHYSICS_STEP_S
        self.yaw_rate += turn * rig.PHYSICS_STEP_S


def clamp(command: float) -> float:
    """Return a command within -1..1."""
    return min(max(float(command), -1.0), 1.0)


def _tyre_force(slip: float, grip_n: float) -> float:
    """Return a tyre's side force in newtons at a slip angle in radians (magic formula)."""
    return grip_n * math.sin(TYRE_SHAPE * math.atan(TYRE_STIFFNESS * slip))

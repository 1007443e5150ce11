"""Speed controllers, chosen by `speed=` of `drivezoo drive`, and the steering filter."""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from zoo.base.errors import InputError
from zoo.base.limits import MOST_MPH, is_ordinary
from zoo.checkpoints.policy_base import Command

LONGEST_STEP_S = 0.5  # longest step that the integral counts; a longer one is a pause
REVERSES_BELOW_MPH = 5.0  # below it, a negative throttle makes the original's car reverse
# The Udacity course's controller sums the error per telemetry message, and its server received
# 43 messages per second.
TELEMETRY_HZ = 43.0

NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
AboveZero = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Pedal = Annotated[float, Field(ge=-1, le=1)]


class SpeedController(ABC):
    """Controller that returns a throttle for each telemetry.

    Attributes:
        set_mph: speed to hold, which may change during a drive; None if none is held.
        needs_spread: whether the policy must predict the spread of its steering.
    """

    set_mph: float | None
    needs_spread: bool = False

    @abstractmethod
    def throttle(self, command: Command, speed_mph: float, now_s: float) -> float:
        """Return the throttle without limits; negative brakes.

        Args:
            command: command of the policy, with the steering that is sent.
            speed_mph: speed of the car.
            now_s: time of the drive in seconds.
        """

    def reset(self) -> None:  # noqa: B027 - a controller without a state has nothing to forget
        """Forget earlier telemetry, after a person drove."""

    def pedal(self, command: Command, speed_mph: float, now_s: float) -> float:
        """Return the throttle to send, -1..1; 0 to hold a speed while the car's is unknown."""
        if self.set_mph is not None and not is_ordinary(speed_mph, most=MOST_MPH):
            return 0.0
        return limit_pedal(self.throttle(command, speed_mph, now_s), speed_mph)


@dataclass
class PI(SpeedController):
    """PI controller of the Udacity course, scaled by the elapsed time.

    It may slow down in bends, and where the policy doubts its steering: the speed to hold falls
    linearly with the steering, and with its spread. An unknown spread counts as `unsure`.

    Args:
        set_mph: speed to hold.
        kp: throttle per mph of speed error.
        ki: throttle per mph of speed error and 1/43 s, the telemetry interval of the course's
            server.
        bend_mph: speed to hold at full steering; null keeps `set_mph`.
        doubt_mph: speed to hold at full doubt; null: the spread changes nothing.
        sure: spread, a standard deviation of the steering, up to which the car does not slow down.
        unsure: spread from which the car holds `doubt_mph`; above `sure`.
    """

    set_mph: NotNegative
    kp: NotNegative
    ki: NotNegative = 0.0
    bend_mph: NotNegative | None = None
    doubt_mph: NotNegative | None = None
    sure: NotNegative = 0.05
    unsure: NotNegative = 0.2

    def __post_init__(self) -> None:
        """Check the spreads.

        Raises:
            InputError: `unsure` is not above `sure`.
        """
        if not self.unsure > self.sure:
            raise InputError(f"speed.unsure={self.unsure}: must be above sure={self.sure}")
        self.needs_spread = self.doubt_mph is not None
        self.reset()

    def reset(self) -> None:
        """Forget the integral."""
        self._integral = 0.0
        self._last_s: float | None = None

    def throttle(self, command: Command, speed_mph: float, now_s: float) -> float:
        """Return the throttle that reduces the speed error."""
        error = self.target_mph(command) - speed_mph
        elapsed_s = 0.0 if self._last_s is None else min(now_s - self._last_s, LONGEST_STEP_S)
        self._last_s = now_s
        integral = self._integral + error * elapsed_s * TELEMETRY_HZ
        wanted = self.kp * error + self.ki * integral
        # Anti-windup: the integral stops growing while the pedal is at its limit.
        if abs(wanted) <= 1 or wanted * error < 0:
            self._integral = integral
        return wanted

    def target_mph(self, command: Command) -> float:
        """Return the speed to hold."""
        spread = math.nan if command.spread is None else command.spread
        doubt = 1.0 if math.isnan(spread) else (spread - self.sure) / (self.unsure - self.sure)
        target_mph = self.set_mph
        for least_mph, share in ((self.bend_mph, abs(command.steering)), (self.doubt_mph, doubt)):
            if least_mph is not None and least_mph < self.set_mph:
                slower = (self.set_mph - least_mph) * min(max(share, 0.0), 1.0)
                target_mph = min(target_mph, self.set_mph - slower)
        return target_mph


class Constant(SpeedController):
    """Constant throttle; the car slows down uphill.

    Args:
        throttle: throttle, -1..1.
    """

    set_mph = None

    def __init__(self, throttle: Pedal) -> None:
        self.value = float(throttle)

    def throttle(self, command: Command, speed_mph: float, now_s: float) -> float:
        """Return the constant throttle."""
        return self.value


@dataclass
class Network(SpeedController):
    """Throttle that the network predicts, such as one of `model=nvidia_speed`.

    Args:
        gain: factor of the predicted throttle.
        fallback: throttle if the network predicts none, -1..1.
    """

    gain: NotNegative = 1.0
    fallback: Pedal = 0.2
    set_mph = None

    def throttle(self, command: Command, speed_mph: float, now_s: float) -> float:
        """Return the predicted throttle times the gain, or the fallback."""
        return self.fallback if command.throttle is None else self.gain * command.throttle


@dataclass
class SteeringFilter:
    """Steering filter: a gain, then a low pass, then a rate limit; the last two off by default.

    Args:
        gain: factor of the network's steering.
        low_pass_s: time constant of a first-order low pass in seconds; null for no low pass.
        rate_per_s: greatest change of the steering (-1..1) per second; null for no limit.
    """

    gain: AboveZero = 1.0
    low_pass_s: AboveZero | None = None
    rate_per_s: AboveZero | None = None

    def __post_init__(self) -> None:
        """Begin without earlier steering."""
        self.reset()

    def reset(self) -> None:
        """Forget earlier steering, after a person drove."""
        self._smooth: float | None = None
        self._last: float | None = None
        self._last_s = 0.0

    def __call__(self, steering: float, now_s: float) -> float:
        """Return the steering to send, -1..1.

        Args:
            steering: steering of the network, -1..1.
            now_s: time of the drive in seconds.
        """
        elapsed_s, self._last_s = now_s - self._last_s, now_s
        wanted = min(max(self.gain * steering, -1.0), 1.0)
        if self.low_pass_s is not None:
            if self._smooth is not None:
                share = 1 - math.exp(-elapsed_s / self.low_pass_s)
                wanted = self._smooth + share * (wanted - self._smooth)
            self._smooth = wanted
        if self.rate_per_s is not None and self._last is not None:
            most = self.rate_per_s * elapsed_s
            wanted = min(max(wanted, self._last - most), self._last + most)
        self._last = wanted
        return wanted


def limit_pedal(throttle: float, speed_mph: float) -> float:
    """Return a throttle in -1..1, without the brake at speeds at which the car would reverse."""
    return min(max(throttle, -1.0 if speed_mph > REVERSES_BELOW_MPH else 0.0), 1.0)

"""Speed controllers, chosen by `speed=` of `drivezoo drive`."""

import math
from typing import Protocol

from zoo.base.errors import InputError

LONGEST_STEP_S = 0.5  # longest step that the integral counts; a longer one is a pause
LIMIT_GAIN = 0.2  # throttle per mph below a speed limit; above it, brake per mph
REVERSES_BELOW_MPH = 5.0  # below it, a negative throttle makes the original's car reverse
# The Udacity course's controller sums the error per telemetry message, and its server received
# 43 messages per second.
TELEMETRY_HZ = 43.0


class SpeedController(Protocol):
    """Controller that returns a throttle for each telemetry.

    Attributes:
        set_mph: speed to hold, which may change during a drive; None if none is held.
        needs_spread: whether the policy must predict the spread of its steering.
    """

    set_mph: float | None
    needs_spread: bool

    def throttle(
        self,
        speed_mph: float,
        steering: float,
        predicted: float | None,
        now_s: float,
        spread: float | None = None,
    ) -> float:
        """Return the throttle; negative brakes. `limit_pedal` limits it to -1..1.

        Args:
            speed_mph: speed of the car.
            steering: steering that is sent, -1..1.
            predicted: throttle of the network, -1..1; None if it predicts none.
            now_s: time of the drive in seconds.
            spread: standard deviation of the steering; None if the policy predicts none.
        """

    def reset(self) -> None:
        """Forget earlier telemetry, after a person drove."""


class PI:
    """PI controller of the Udacity course, scaled by the elapsed time.

    Args:
        set_mph: speed to hold.
        kp: throttle per mph of speed error.
        ki: throttle per mph of speed error and 1/43 s, the telemetry interval of the course's
            server.
        bend_mph: speed to hold at full steering; the speed to hold falls linearly with the
            steering. None keeps `set_mph`.
    """

    needs_spread = False

    def __init__(
        self, set_mph: float, kp: float, ki: float = 0.0, bend_mph: float | None = None
    ) -> None:
        _check("set_mph", set_mph, least=0)
        _check("kp", kp, least=0)
        _check("ki", ki, least=0)
        if bend_mph is not None:
            _check("bend_mph", bend_mph, least=0)
        self.set_mph = float(set_mph)
        self.kp, self.ki, self.bend_mph = kp, ki, bend_mph
        self.reset()

    def reset(self) -> None:
        """Forget the integral."""
        self._integral = 0.0
        self._last_s: float | None = None

    def throttle(
        self,
        speed_mph: float,
        steering: float,
        predicted: float | None,
        now_s: float,
        spread: float | None = None,
    ) -> float:
        """Return the throttle that reduces the speed error."""
        error = self.target_mph(steering, spread) - speed_mph
        elapsed_s = 0.0 if self._last_s is None else min(now_s - self._last_s, LONGEST_STEP_S)
        self._last_s = now_s
        integral = self._integral + error * elapsed_s * TELEMETRY_HZ
        wanted = self.kp * error + self.ki * integral
        # Anti-windup: the integral stops growing while the pedal is at its limit.
        if abs(wanted) <= 1 or wanted * error < 0:
            self._integral = integral
        return wanted

    def target_mph(self, steering: float, spread: float | None = None) -> float:
        """Return the speed to hold at a steering of -1..1, whatever its spread."""
        if self.bend_mph is None or self.bend_mph >= self.set_mph:
            return self.set_mph
        return self.set_mph - (self.set_mph - self.bend_mph) * min(abs(steering), 1.0)


class Doubt(PI):
    """PI controller that slows down where the policy doubts its steering.

    The speed to hold falls linearly from `set_mph` at a spread of `sure` to `doubt_mph` at a spread
    of `unsure`. An unknown spread counts as `unsure`.

    Args:
        set_mph: speed to hold.
        kp: see `PI`.
        ki: see `PI`.
        doubt_mph: speed to hold at full doubt.
        sure: spread, a standard deviation of the steering, up to which the car does not slow down.
        unsure: spread from which the car holds `doubt_mph`; above `sure`.
    """

    needs_spread = True

    def __init__(
        self, set_mph: float, kp: float, ki: float, doubt_mph: float, sure: float, unsure: float
    ) -> None:
        super().__init__(set_mph, kp, ki)
        _check("doubt_mph", doubt_mph, least=0)
        _check("sure", sure, least=0)
        _check("unsure", unsure, least=sure)
        if unsure == sure:
            raise InputError(f"speed.unsure={unsure}: must be above sure={sure}")
        self.doubt_mph, self.sure, self.unsure = doubt_mph, sure, unsure

    def target_mph(self, steering: float, spread: float | None = None) -> float:
        """Return the speed to hold at a spread of the steering."""
        if spread is None or math.isnan(spread):
            spread = self.unsure
        share = (spread - self.sure) / (self.unsure - self.sure)
        least = min(self.doubt_mph, self.set_mph)
        return self.set_mph - (self.set_mph - least) * min(max(share, 0.0), 1.0)


class Constant:
    """Constant throttle; the car slows down uphill.

    Args:
        throttle: throttle, -1..1.
    """

    set_mph: float | None = None
    needs_spread = False

    def __init__(self, throttle: float) -> None:
        _check("throttle", throttle, least=-1, most=1)
        self.value = float(throttle)

    def reset(self) -> None:
        """Do nothing; there is no state."""

    def throttle(
        self,
        speed_mph: float,
        steering: float,
        predicted: float | None,
        now_s: float,
        spread: float | None = None,
    ) -> float:
        """Return the constant throttle."""
        return self.value


class Network:
    """Throttle that the network predicts, such as one of `model=nvidia_speed`.

    Args:
        gain: factor of the predicted throttle.
        fallback: throttle if the network predicts none, -1..1.
    """

    set_mph: float | None = None
    needs_spread = False

    def __init__(self, gain: float = 1.0, fallback: float = 0.2) -> None:
        _check("gain", gain, least=0)
        _check("fallback", fallback, least=-1, most=1)
        self.gain, self.fallback = gain, fallback

    def reset(self) -> None:
        """Do nothing; there is no state."""

    def throttle(
        self,
        speed_mph: float,
        steering: float,
        predicted: float | None,
        now_s: float,
        spread: float | None = None,
    ) -> float:
        """Return the predicted throttle times the gain, or the fallback."""
        return self.fallback if predicted is None else self.gain * predicted


def keep_limit(
    controller: SpeedController, throttle: float, speed_mph: float, limit_mph: float | None
) -> float:
    """Return a throttle that slows the car down to a speed limit.

    The controller forgets its integral, which would grow while the car is slower than it wants.

    Args:
        controller: controller that returned the throttle.
        throttle: throttle of the controller.
        speed_mph: speed of the car.
        limit_mph: speed limit; None for none.
    """
    if limit_mph is None:
        return throttle
    controller.reset()
    return min(throttle, LIMIT_GAIN * (limit_mph - speed_mph))


def limit_pedal(throttle: float, speed_mph: float) -> float:
    """Return a throttle in -1..1, without the brake at speeds at which the car would reverse."""
    return min(max(throttle, -1.0 if speed_mph > REVERSES_BELOW_MPH else 0.0), 1.0)


def _check(key: str, value: float, least: float, most: float = math.inf) -> None:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not (is_number and least <= value <= most):
        bounds = f"a number, {least:g} or more" if most == math.inf else f"in {least:g}..{most:g}"
        raise InputError(f"speed.{key}={value}: must be {bounds}")

"""Speed controllers, chosen by `speed=` of `drivezoo drive`, and the steering filter."""

import math
from abc import ABC, abstractmethod

from zoo.base.errors import InputError

LONGEST_STEP_S = 0.5  # longest step that the integral counts; a longer one is a pause
LIMIT_GAIN = 0.2  # throttle per mph below a speed limit; above it, brake per mph
REVERSES_BELOW_MPH = 5.0  # below it, a negative throttle makes the original's car reverse
# The Udacity course's controller sums the error per telemetry message, and its server received
# 43 messages per second.
TELEMETRY_HZ = 43.0


class SpeedController(ABC):
    """Controller that returns a throttle for each telemetry.

    Attributes:
        set_mph: speed to hold, which may change during a drive; None if none is held.
        needs_spread: whether the policy must predict the spread of its steering.
    """

    set_mph: float | None = None
    needs_spread = False

    @abstractmethod
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

    def reset(self) -> None:  # noqa: B027 - a controller without a state has nothing to forget
        """Forget earlier telemetry, after a person drove."""


class PI(SpeedController):
    """PI controller of the Udacity course, scaled by the elapsed time.

    Args:
        set_mph: speed to hold.
        kp: throttle per mph of speed error.
        ki: throttle per mph of speed error and 1/43 s, the telemetry interval of the course's
            server.
        bend_mph: speed to hold at full steering; the speed to hold falls linearly with the
            steering. None keeps `set_mph`.
    """

    set_mph: float

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


class Constant(SpeedController):
    """Constant throttle; the car slows down uphill.

    Args:
        throttle: throttle, -1..1.
    """

    def __init__(self, throttle: float) -> None:
        _check("throttle", throttle, least=-1, most=1)
        self.value = float(throttle)

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


class Network(SpeedController):
    """Throttle that the network predicts, such as one of `model=nvidia_speed`.

    Args:
        gain: factor of the predicted throttle.
        fallback: throttle if the network predicts none, -1..1.
    """

    def __init__(self, gain: float = 1.0, fallback: float = 0.2) -> None:
        _check("gain", gain, least=0)
        _check("fallback", fallback, least=-1, most=1)
        self.gain, self.fallback = gain, fallback

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


class SteeringFilter:
    """Steering filter: a gain, then a low pass, then a rate limit; the last two off by default.

    Args:
        gain: factor of the network's steering.
        low_pass_s: time constant of a first-order low pass in seconds; None for no low pass.
        rate_per_s: greatest change of the steering (-1..1) per second; None for no limit.
    """

    def __init__(
        self,
        gain: float = 1.0,
        low_pass_s: float | None = None,
        rate_per_s: float | None = None,
    ) -> None:
        for key, value in (("gain", gain), ("low_pass_s", low_pass_s), ("rate_per_s", rate_per_s)):
            number = isinstance(value, int | float) and not isinstance(value, bool)
            positive = number and value is not None and 0 < value < math.inf
            if not positive and not (value is None and key != "gain"):
                raise InputError(f"drive.steering.{key}={value}: must be a number above 0")
        self.gain, self.low_pass_s, self.rate_per_s = gain, low_pass_s, rate_per_s
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

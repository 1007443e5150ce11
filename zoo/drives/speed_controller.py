"""How much throttle: one class for each way, chosen by `drive.speed` (`conf/drive/speed`)."""

import math
from typing import Protocol

from datamodules.errors import InputError

LONGEST_STEP_S = 0.5  # a longer one is a pause, which is not to be made up for
REVERSES_BELOW_MPH = 5.0  # the car of the original reverses, where it does not brake, below this
# The course's controller added up an error per telemetry; its server got 43 of them a second.
TELEMETRY_HZ = 43.0


class SpeedController(Protocol):
    """The throttle for each telemetry, -1..1, negative brakes. `set_mph` is None for those that
    hold no speed, and may be changed while driving."""

    set_mph: float | None

    def throttle(
        self, speed_mph: float, steering: float, predicted: float | None, now_s: float
    ) -> float: ...

    def reset(self) -> None:
        """Forget the past: someone else has driven for a while."""


class PI:
    """The course's controller: proportional and integral, by real elapsed time.

    Args:
        set_mph: the speed to hold.
        kp: throttle per mph that is missing.
        ki: throttle per mph that is missing, for each of the 43 telemetry messages a second that
            the course's own server got.
        bend_mph: the speed at full steering, on which the set speed falls evenly; None holds it.
    """

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
        self._integral = 0.0
        self._last_s: float | None = None

    def throttle(
        self, speed_mph: float, steering: float, predicted: float | None, now_s: float
    ) -> float:
        error = self.target_mph(steering) - speed_mph
        elapsed_s = 0.0 if self._last_s is None else min(now_s - self._last_s, LONGEST_STEP_S)
        self._last_s = now_s
        integral = self._integral + error * elapsed_s * TELEMETRY_HZ
        wanted = self.kp * error + self.ki * integral
        # Anti-windup: what the pedal cannot do is not remembered.
        if abs(wanted) <= 1 or wanted * error < 0:
            self._integral = integral
        return wanted

    def target_mph(self, steering: float) -> float:
        """The speed to hold at a steering of -1..1."""
        if self.bend_mph is None or self.bend_mph >= self.set_mph:
            return self.set_mph
        return self.set_mph - (self.set_mph - self.bend_mph) * min(abs(steering), 1.0)


class Constant:
    """The same throttle always; the hills decide how fast."""

    set_mph: float | None = None

    def __init__(self, throttle: float) -> None:
        _check("throttle", throttle, least=-1, most=1)
        self.value = float(throttle)

    def reset(self) -> None:
        pass

    def throttle(
        self, speed_mph: float, steering: float, predicted: float | None, now_s: float
    ) -> float:
        return self.value


class Network:
    """The network's own throttle (`model=nvidia_speed` gives one).

    Args:
        gain: multiplies it.
        fallback: the throttle where the network gives none.
    """

    set_mph: float | None = None

    def __init__(self, gain: float = 1.0, fallback: float = 0.2) -> None:
        _check("gain", gain, least=0)
        _check("fallback", fallback, least=-1, most=1)
        self.gain, self.fallback = gain, fallback

    def reset(self) -> None:
        pass

    def throttle(
        self, speed_mph: float, steering: float, predicted: float | None, now_s: float
    ) -> float:
        return self.fallback if predicted is None else self.gain * predicted


def limit_pedal(throttle: float, speed_mph: float) -> float:
    """Throttle within -1..1, and no brake at a speed at which the car would reverse instead."""
    return min(max(throttle, -1.0 if speed_mph > REVERSES_BELOW_MPH else 0.0), 1.0)


def _check(key: str, value: float, least: float, most: float = math.inf) -> None:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not (is_number and least <= value <= most):
        bounds = f"a number, {least:g} or more" if most == math.inf else f"in {least:g}..{most:g}"
        raise InputError(f"drive.speed.{key}={value} is not {bounds}")

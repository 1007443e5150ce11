"""Filter of the network's steering before it is sent: gain, low pass, rate limit."""

import math

from zoo.base.errors import InputError


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

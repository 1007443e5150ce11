"""What becomes of the network's steering before it is sent: gain, low pass, rate limit."""

import math

from datamodules.errors import InputError


class SteeringFilter:
    """Applies gain, then low pass, then rate limit, by elapsed time; the last two off by default.

    Args:
        gain: multiplies the network's steering.
        low_pass_s: the time constant of a first-order low pass; None for none.
        rate_per_s: the most that the steering (-1..1) changes in a second; None for any.
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
                raise InputError(f"drive.steering.{key}={value} is not a number above 0")
        self.gain, self.low_pass_s, self.rate_per_s = gain, low_pass_s, rate_per_s
        self.reset()

    def reset(self) -> None:
        """Forget the past: someone else has driven for a while."""
        self._smooth: float | None = None
        self._last: float | None = None
        self._last_s = 0.0

    def __call__(self, steering: float, now_s: float) -> float:
        """The network's steering, and the time -> the steering to send, -1..1."""
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

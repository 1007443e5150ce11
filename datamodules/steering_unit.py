"""The meaning of a recording's steering numbers: unit, full lock and sign."""

from dataclasses import asdict, dataclass
from typing import Literal

import numpy as np


@dataclass(frozen=True)
class SteeringUnit:
    """What the steering numbers of a source mean.

    Attributes:
        unit: `share` of full lock, `deg` or `rad` of the steering wheel or of the front wheels,
            `servo` for a servo's own numbers, or `px` of a point in the image.
        full: distance from `zero`, in this unit, at which the steering is 1.
        right: sign of a steering to the right.
        zero: number that steers straight ahead.
    """

    unit: Literal["share", "deg", "rad", "servo", "px"] = "share"
    full: float = 1.0
    right: Literal["positive", "negative"] = "positive"
    zero: float = 0.0

    def steering(self, values: np.ndarray) -> np.ndarray:
        """Return the steering, float64 [N], right positive, 1 at full lock, of values."""
        sign = 1.0 if self.right == "positive" else -1.0
        return (values - self.zero) * (sign / self.full)

    def key(self) -> str:
        """Return the key that sets this meaning."""
        fields = ", ".join(f"{name}: {value}" for name, value in asdict(self).items() if value != 0)
        return f"steering={{{fields}}}"

    def words(self) -> str:
        """Return the meaning in words, such as `deg, 540 at full lock, right positive`."""
        zero = f", {self.zero:g} straight ahead" if self.zero else ""
        return f"{self.unit}, {self.full:g} at full lock{zero}, right {self.right}"

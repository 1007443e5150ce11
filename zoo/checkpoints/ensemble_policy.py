"""Ensembles: Lakshminarayanan et al. 2017, "Simple and scalable predictive uncertainty"."""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from zoo.checkpoints.command import Command, Policy, mixture


class EnsemblePolicy(Policy):
    """A policy that asks several policies, and returns their mean and spread.

    Each member has its own view. Where members predict a spread of their own, the variance is the
    mean of theirs plus the variance of their steering.

    Args:
        members: policies of checkpoints.

    Attributes:
        view: the first member's.
        config: the first member's, with `name` as the model's name.
        data: the members', where it is the same for all; else empty.
    """

    predicts_spread = True

    def __init__(self, members: Sequence[Policy]) -> None:
        self._members = tuple(members)
        first = self.members[0]
        self.view = first.view
        self.data = first.data if all(one.data == first.data for one in self.members) else {}
        counts = Counter(one.name for one in self.members)
        self.name = " and ".join(f"{count} {name}" for name, count in counts.items())
        model = first.config.get("model", {}) | {"name": self.name}
        self.config = {**first.config, "model": model}
        self.parameters = sum(one.parameters for one in self.members)
        self.takes_speed = any(one.takes_speed for one in self.members)
        self.outputs = min(one.outputs for one in self.members)

    @property
    def members(self) -> tuple[Policy, ...]:
        """Return the policies of the ensemble."""
        return self._members

    def __call__(self, frame: np.ndarray, speed_mph: float) -> Command:
        """Return the members' mean command for a frame; its spread is theirs."""
        return mixture([one(frame, speed_mph) for one in self.members])

    def reset(self) -> None:
        """Reset the members."""
        for one in self.members:
            one.reset()

    def session(self) -> "EnsemblePolicy":
        """Return an ensemble for one more car."""
        return EnsemblePolicy([one.session() for one in self.members])

    @property
    def latency_s(self) -> float | None:
        """Return the seconds from a command to the wheels; None if no member predicts ahead."""
        return next((one.latency_s for one in self.members if one.latency_s is not None), None)

    @latency_s.setter
    def latency_s(self, seconds: float | None) -> None:
        for one in self.members:
            if one.latency_s is not None:
                one.latency_s = seconds

    def expect(self, steering: np.ndarray) -> None:
        """Pass on the steering that the wheels will have."""
        for one in self.members:
            one.expect(steering)

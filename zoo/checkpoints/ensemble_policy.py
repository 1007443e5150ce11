"""Ensembles: Lakshminarayanan et al. 2017, "Simple and scalable predictive uncertainty"."""

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from zoo.checkpoints.command import (
    Command,
    call_policy,
    expect_steering,
    mixture,
    own_session,
    reset_policy,
)


class EnsemblePolicy:
    """A policy that asks several policies, and returns their mean and spread.

    Each member has its own view. Where members predict a spread of their own, the variance is the
    mean of theirs plus the variance of their steering.

    Args:
        members: policies, each as `zoo.checkpoints.policy.Policy`.

    Attributes:
        view: the first member's.
        config: the first member's, with `name` as the model's name.
        data: the members', where it is the same for all; else empty.
        name, parameters, takes_speed, outputs, predicts_spread: as in
            `zoo.checkpoints.policy.Policy`.
    """

    predicts_spread = True

    def __init__(self, members: Sequence[Any]) -> None:
        self.members = tuple(members)
        first = self.members[0]
        self.view = first.view
        self.data = first.data if all(one.data == first.data for one in self.members) else {}
        counts = Counter(one.name for one in self.members)
        self.name = " and ".join(f"{count} {name}" for name, count in counts.items())
        self.config = first.config | {"model": first.config.get("model", {}) | {"name": self.name}}
        self.parameters = sum(one.parameters for one in self.members)
        self.takes_speed = any(one.takes_speed for one in self.members)
        self.outputs = min(one.outputs for one in self.members)

    def __call__(self, frame: np.ndarray, speed_mph: float) -> Command:
        """Return the members' mean command for a frame; its spread is theirs."""
        return mixture([call_policy(one, frame, speed_mph) for one in self.members])

    def reset(self) -> None:
        """Reset the members."""
        for one in self.members:
            reset_policy(one)

    def new_session(self) -> "EnsemblePolicy":
        """Return an ensemble for one more car."""
        return EnsemblePolicy([own_session(one) for one in self.members])

    @property
    def latency_s(self) -> float:
        """Return the seconds from a command to the wheels, where a member predicts ahead."""
        return float(self._ahead()[0].latency_s)

    @latency_s.setter
    def latency_s(self, seconds: float) -> None:
        for one in self._ahead():
            one.latency_s = seconds

    def expect(self, steering: np.ndarray) -> None:
        """Tell the members that predict ahead which steering the wheels will have."""
        for one in self._ahead():
            expect_steering(one, steering)

    def _ahead(self) -> list[Any]:
        """Return the members that predict ahead; without one, `latency_s` does not exist."""
        found = [one for one in self.members if hasattr(one, "latency_s")]
        if not found:
            raise AttributeError("latency_s")
        return found

"""A policy whose frames a guard watches."""

from collections import deque
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from zoo.checkpoints.command import Command, Policy, PolicyWrapper
from zoo.monitor.guard_file import Guard, check_checkpoint, read_guard
from zoo.monitor.scores import METHODS
from zoo.monitor.signals import make_source


class GuardedPolicy(PolicyWrapper):
    """Policy that sets a speed limit while its guard fires.

    The guard fires while the mean score of the last window of frames is above the threshold. It
    does not change the steering.

    Args:
        policy: policy that drives.
        guard: guard that watches.
    """

    def __init__(self, policy: Policy, guard: Guard) -> None:
        super().__init__(policy)
        self.guard, self._alarms = guard, [0]
        self._source = make_source(METHODS[guard.score.method].signal, policy, guard.samples)
        self._begin()

    def _begin(self) -> None:
        guard = self.guard
        self._signals: deque[Any] = deque(maxlen=METHODS[guard.score.method].frames)
        self._scores: deque[float] = deque(maxlen=guard.window)
        self.fires = False

    def __call__(self, frame: np.ndarray, speed_mph: float) -> Command:
        """Return the policy's command for a frame, with a speed limit while the guard fires."""
        command = self.policy(frame, speed_mph)
        self._signals.append(self._source(frame, speed_mph, command))
        self._scores.append(float(self.guard.score(np.array(self._signals))[-1]))
        whole = len(self._scores) == self.guard.window
        fires = whole and float(np.mean(self._scores)) > self.guard.threshold
        self._alarms[0] += fires and not self.fires
        self.fires = fires
        return replace(command, limit_mph=self.guard.limit_mph) if fires else command

    @property  # type: ignore[override]
    def alarms(self) -> int:
        """Return how often the guard has begun to fire, in all sessions."""
        return self._alarms[0]

    def reset(self) -> None:
        """Forget the frames before."""
        super().reset()
        self._begin()

    def session(self) -> "GuardedPolicy":
        """Return the policy for one more car, with a window of its own."""
        other = super().session()
        other._begin()
        return other


def guarded(policy: Policy, checkpoint: str | Path, guard: str | Path) -> GuardedPolicy:
    """Return a policy that the guard of a file watches.

    Args:
        policy: policy that drives.
        checkpoint: file that the policy was loaded from.
        guard: path of the guard file.

    Raises:
        InputError: see `read_guard`; or the guard was fitted with another checkpoint.
    """
    found = read_guard(guard)
    check_checkpoint(guard, found, checkpoint)
    return GuardedPolicy(policy, found)

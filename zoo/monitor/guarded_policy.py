"""A policy whose frames a guard watches."""

from collections import deque
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from zoo.checkpoints.command import Command, PolicyFunction, call_policy, own_session, reset_policy
from zoo.monitor.guard_file import Guard, check_checkpoint, read_guard
from zoo.monitor.scores import METHODS
from zoo.monitor.signals import Source, make_source


class GuardedPolicy:
    """Policy that sets a speed limit while its guard fires.

    The guard fires while the mean score of the last window of frames is above the threshold. It
    does not change the steering. Other attributes are those of the policy.

    Args:
        policy: policy that drives.
        guard: guard that watches.
    """

    def __init__(self, policy: PolicyFunction, guard: Guard) -> None:
        method = METHODS[guard.score.method]
        self._begin(policy, guard, make_source(method.signal, policy, guard.samples), [0])

    def _begin(
        self, policy: PolicyFunction, guard: Guard, source: Source, alarms: list[int]
    ) -> None:
        self.policy, self.guard = policy, guard
        self._source, self._alarms = source, alarms
        self._signals: deque[Any] = deque(maxlen=METHODS[guard.score.method].frames)
        self._scores: deque[float] = deque(maxlen=guard.window)
        self.fires = False

    def __call__(self, frame: np.ndarray, speed_mph: float) -> Command:
        """Return the policy's command for a frame, with a speed limit while the guard fires."""
        command = call_policy(self.policy, frame, speed_mph)
        self._signals.append(self._source(frame, speed_mph, command))
        self._scores.append(float(self.guard.score(np.array(self._signals))[-1]))
        whole = len(self._scores) == self.guard.window
        fires = whole and float(np.mean(self._scores)) > self.guard.threshold
        self._alarms[0] += fires and not self.fires
        self.fires = fires
        return replace(command, limit_mph=self.guard.limit_mph) if fires else command

    @property
    def alarms(self) -> int:
        """Return how often the guard has begun to fire, in all sessions."""
        return self._alarms[0]

    def reset(self) -> None:
        """Forget the frames before."""
        reset_policy(self.policy)
        self._signals.clear()
        self._scores.clear()
        self.fires = False

    def new_session(self) -> "GuardedPolicy":
        """Return the policy for one more car, with a window of its own."""
        other = object.__new__(GuardedPolicy)
        other._begin(own_session(self.policy), self.guard, self._source, self._alarms)
        return other

    @property
    def latency_s(self) -> float:
        """Return the policy's seconds from a command to the wheels, if it has them."""
        return self.policy.latency_s

    @latency_s.setter
    def latency_s(self, seconds: float) -> None:
        self.policy.latency_s = seconds

    def __getattr__(self, name: str) -> Any:
        if name == "policy":  # not set yet
            raise AttributeError(name)
        return getattr(self.policy, name)


def guarded(policy: PolicyFunction, checkpoint: str | Path, guard: str | Path) -> GuardedPolicy:
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

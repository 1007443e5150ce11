"""What a policy returns, and the state that some policies keep between frames."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np


class Command(NamedTuple):
    """A policy's output for one frame.

    Attributes:
        steering: steering -1..1, negative is left.
        throttle: throttle -1..1, negative brakes; None from a network that predicts none.
        spread: standard deviation of the steering, 0 or more, by which the policy doubts it; None
            from a policy that does not know.
        limit_mph: speed to slow down to, by a guard that fires; None for no limit.
    """

    steering: float
    throttle: float | None = None
    spread: float | None = None
    limit_mph: float | None = None


# Function of a frame, uint8 [160, 320, 3] RGB (None in a world without a renderer), and mph. A
# plain function may return a pair of steering and throttle.
PolicyFunction = Callable[[Any, float], Command | tuple[float, float | None]]


def call_policy(policy: PolicyFunction, frame: np.ndarray | None, speed_mph: float) -> Command:
    """Return a policy's command for a frame; see `PolicyFunction`."""
    return Command(*policy(frame, speed_mph))


def reset_policy(policy: PolicyFunction) -> None:
    """Let a policy forget the frames before, at a start and after the car was put back."""
    reset = getattr(policy, "reset", None)
    if reset is not None:
        reset()


def own_session(policy: PolicyFunction) -> PolicyFunction:
    """Return the policy for one more car: with a state of its own, if it keeps one."""
    new_session = getattr(policy, "new_session", None)
    return policy if new_session is None else new_session()

"""What a policy returns, and the state that some policies keep between frames."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Command:
    """A policy's output for one frame; it unpacks as the pair of steering and throttle.

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

    def __iter__(self) -> Iterator[float | None]:
        return iter((self.steering, self.throttle))

    def __getitem__(self, number: int) -> float | None:
        return (self.steering, self.throttle)[number]


# Function of a frame, uint8 [160, 320, 3] RGB (None in a world without a renderer), and mph. A
# plain function may return a pair of steering and throttle.
PolicyFunction = Callable[[Any, float], Command | tuple[float, float | None]]


def call_policy(policy: PolicyFunction, frame: np.ndarray | None, speed_mph: float) -> Command:
    """Return a policy's command for a frame; see `PolicyFunction`."""
    found = policy(frame, speed_mph)
    return found if isinstance(found, Command) else Command(*found)


def output_command(outputs: Sequence[float], predicts_spread: bool) -> Command:
    """Return the command of a network's row of outputs.

    >>> output_command([1.25, math.log(0.5)], predicts_spread=True)
    Command(steering=1.0, throttle=None, spread=0.5, limit_mph=None)
    """
    controls = outputs[:-1] if predicts_spread else outputs
    steering, *throttle = (min(max(one, -1.0), 1.0) for one in controls)
    spread = math.exp(min(outputs[-1], 100.0)) if predicts_spread else None
    return Command(steering, throttle[0] if throttle else None, spread)


def mixture(commands: Sequence[Command]) -> Command:
    """Return the mean command, with the standard deviation of the mixture as its spread.

    The variance is that of the steering plus the mean of the commands' own variances
    (Lakshminarayanan et al. 2017). There is a throttle only if all commands have one.

    >>> mixture([Command(0.0), Command(0.5)])
    Command(steering=0.25, throttle=None, spread=0.25, limit_mph=None)
    """
    count = len(commands)
    steering = sum(one.steering for one in commands) / count
    squares = ((one.steering - steering) ** 2 + (one.spread or 0.0) ** 2 for one in commands)
    throttles = [one.throttle for one in commands if one.throttle is not None]
    throttle = sum(throttles) / count if len(throttles) == count else None
    return Command(steering, throttle, math.sqrt(sum(squares) / count))


def expect_steering(policy: PolicyFunction, steering: np.ndarray) -> None:
    """Tell a policy the wheels' steering until its command reaches them; most need not know it.

    Args:
        policy: policy; told if it has a method `expect`, as policies that predict ahead have.
        steering: float [n], -1..1, evenly spaced over the policy's `latency_s`.
    """
    expect = getattr(policy, "expect", None)
    if expect is not None:
        expect(steering)


def reset_policy(policy: PolicyFunction) -> None:
    """Let a policy forget the frames before, at a start and after the car was put back."""
    reset = getattr(policy, "reset", None)
    if reset is not None:
        reset()


def own_session(policy: PolicyFunction) -> PolicyFunction:
    """Return the policy for one more car: with a state of its own, if it keeps one."""
    new_session = getattr(policy, "new_session", None)
    return policy if new_session is None else new_session()


def policy_name(policy: PolicyFunction) -> str:
    """Return the name of a policy's network, or of a function.

    >>> def steer_left(frame, speed_mph): ...
    >>> policy_name(steer_left)
    'steer_left'
    """
    for attribute in ("name", "__name__"):
        if isinstance(name := getattr(policy, attribute, None), str):
            return name
    return type(policy).__name__

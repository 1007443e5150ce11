"""What a policy keeps from frame to frame, and the time that its steering is for."""

import copy
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np

from zoo.checkpoints.command import Policy
from zoo.checkpoints.late_command import distance_m, outputs_at, returning
from zoo.models.window import Window

NOTHING = np.zeros(0)
Session = TypeVar("Session", bound="SessionPolicy")  # typing.Self needs Python 3.11


class FrameMemory:
    """The state of a network of `zoo.models.memory` while it drives one car.

    A network that was trained on every second row keeps two states, which take turns: each sees
    every second frame.

    Args:
        first: state before the first frame.
        stride: number of states.
    """

    def __init__(self, first: Sequence[Any], stride: int = 1) -> None:
        self.first, self.stride = tuple(first), stride
        self.reset()

    def reset(self) -> None:
        """Forget the frames before."""
        self._states = [self.first] * self.stride
        self._turn = 0

    def step(self, step: Callable[..., Sequence[Any]], *inputs: Any) -> Any:
        """Call `step` with the inputs and a state; keep the new state and return the outputs."""
        outputs, *state = step(*inputs, *self._states[self._turn])
        self._states[self._turn] = tuple(state)
        self._turn = (self._turn + 1) % self.stride
        return outputs


class SessionPolicy(Policy):
    """What policies with and without memory share: a state for each session.

    Attributes:
        memory: state of a network with memory; None of one that looks at a single frame.
        window: frames that it was trained on, and steps that it predicts.
    """

    memory: FrameMemory | None = None
    window = Window()
    _steps_per_s = _recorded_mph = 0.0
    _on_the_way = NOTHING

    def keep_memory(self, first: Sequence[Any], window: Window, data: Mapping[str, Any]) -> None:
        """Keep the state of a network with memory.

        Args:
            first: state before the first frame.
            window: network's window.
            data: checkpoint's `data`, with `rows_per_s`, without which the policy ignores latency,
                and `speed_mph`, without which it takes each speed for the recorded one.
        """
        self.memory, self.window = FrameMemory(first, window.stride), window
        if window.ahead:
            self.latency_s = 0.0
            self._steps_per_s = float(data.get("rows_per_s") or 0.0) / window.stride
            self._recorded_mph = float(data.get("speed_mph") or 0.0)

    def reset(self) -> None:
        """Forget the frames and commands before."""
        self._on_the_way = NOTHING
        if self.memory is not None:
            self.memory.reset()

    def session(self: Session) -> Session:
        """Return the policy for one more car, without frames before."""
        other = copy.copy(self)
        other._on_the_way = NOTHING
        if self.memory is not None:
            other.memory = FrameMemory(self.memory.first, self.memory.stride)
        return other

    def expect(self, steering: np.ndarray) -> None:
        """Take the steering of the wheels from now until a command reaches them."""
        self._on_the_way = steering

    def in_time(self, outputs: np.ndarray, speed_mph: float) -> np.ndarray:
        """Return the outputs for the time at which they reach the wheels, [outputs].

        A car that is slower than the recorded ones needs more time for a step.

        Args:
            outputs: outputs for now and for the steps ahead, [1 + ahead, outputs].
            speed_mph: the car's speed in mph.
        """
        if self.latency_s is None:
            return outputs[0]
        steps = self.latency_s * self._steps_per_s
        if self._recorded_mph:
            steps *= max(speed_mph, 0.0) / self._recorded_mph
        found = outputs_at(outputs, steps).copy()
        if steps:
            way = distance_m(speed_mph, self.latency_s)
            found[0] += returning(outputs[:, 0], self._on_the_way, way, steps)
        return found.clip(-1, 1)

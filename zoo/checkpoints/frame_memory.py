"""What a policy keeps from frame to frame, and the time that its steering is for.

A network that predicts steps ahead predicts those of a car that steers as it says. A late car still
steers by earlier commands. The difference moves it off that course, and the command returns it: a
Smith predictor (Smith, "Closer control of loops with dead time", 1957).
"""

import copy
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np

from zoo.base.rig import MPS_PER_MPH, Rig
from zoo.checkpoints.policy_base import Policy
from zoo.models.frame_window import Window

NOTHING = np.zeros(0)
# A car returns to its course as by pure pursuit of a point this far ahead: what the side cameras
# teach with data.offset=0.275.
RETURN_M = 6.2
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
            speed_mph: the car's speed in mph; NaN, for unknown, counts as the recorded one.
        """
        mph = self._recorded_mph if math.isnan(speed_mph) else max(speed_mph, 0.0)
        if not self.label.is_steering:
            outputs = outputs.copy()
            outputs[:, 0] = self.label.steering(outputs[:, 0], self.rig)
        if self.latency_s is None:
            return outputs[0]
        steps = self.latency_s * self._steps_per_s
        if self._recorded_mph:
            steps *= mph / self._recorded_mph
        command = outputs_at(outputs, steps).copy()
        if steps and self.rig:  # of an unknown car, no way follows from its commands
            way_m = mph * MPS_PER_MPH * self.latency_s
            command[0] += returning(outputs[:, 0], self._on_the_way, way_m, steps, self.rig)
        return command.clip(-1, 1)


def outputs_at(outputs: np.ndarray, steps: float) -> np.ndarray:
    """Return the outputs for a time ahead, interpolated between two steps.

    Args:
        outputs: outputs for now and for the steps ahead, [1 + ahead, outputs].
        steps: time ahead, in steps; a time after the last step counts as the last step.

    >>> outputs_at(np.array([[0.0], [0.4], [0.2]]), 1.5).round(1).tolist()
    [0.3]
    """
    steps = min(max(steps, 0.0), len(outputs) - 1.0)
    before = int(steps)
    after = min(before + 1, len(outputs) - 1)
    return outputs[before] + (steps - before) * (outputs[after] - outputs[before])


def returning(
    predicted: np.ndarray, sent: np.ndarray, way_m: float, steps: float, rig: Rig
) -> float:
    """Return the steering, -1..1, that returns a car from where the sent commands lead it.

    Args:
        predicted: steering for now and for the steps ahead, -1..1 [1 + ahead].
        sent: steering that the wheels have until the command reaches them, -1..1 [n], evenly spaced
            in time.
        way_m: distance that the car drives in that time.
        steps: steps in that time.
        rig: driven car.

    >>> from zoo.base.rig import UDACITY
    >>> returning(np.array([0.0, 0.0]), np.array([0.1, 0.1]), 4.0, 1.0, UDACITY) < -0.1
    True
    """
    if not len(sent):
        return 0.0
    parts = (np.arange(len(sent)) + 0.5) / len(sent)
    course = np.interp(parts * steps, np.arange(len(predicted)), predicted)
    bends = rig.curvature(sent) - rig.curvature(course)
    part_m = way_m / len(sent)
    turned = np.cumsum(bends) * part_m
    right_m = float(np.sum(turned - bends * part_m / 2)) * part_m
    return float(rig.steering_of(-2 * (right_m + RETURN_M * float(turned[-1])) / RETURN_M**2))

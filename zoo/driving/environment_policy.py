"""A policy that drives a Gymnasium environment."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from zoo.checkpoints.policy_base import Policy, PolicyFunction, as_policy
from zoo.driving.drive_loop import drivable
from zoo.driving.speed_controller import SpeedController


class EnvironmentPolicy:
    """Policy that drives a Gymnasium environment: `env.step(policy(observation))`.

    Its throttle is that of a speed controller, as in scored drives.

    Args:
        policy: policy that steers.
        speed: speed controller.
        frame_rate: steps of the environment per second of simulated time.
    """

    def __init__(
        self, policy: Policy | PolicyFunction, speed: SpeedController, frame_rate: float
    ) -> None:
        self.policy, self.speed, self.frame_rate = as_policy(policy).session(), speed, frame_rate
        self.reset()

    def reset(self) -> None:
        """Forget the steps before; call it after `env.reset`."""
        self._steps = 0
        self.policy.reset()
        self.speed.reset()

    def __call__(self, observation: Mapping[str, Any]) -> np.ndarray:
        """Return the action for an observation: steering and throttle, float32 [2] in -1..1.

        Args:
            observation: `image`, uint8 [H, W, 3] RGB, and `speed`, float [1] in mph.

        Raises:
            InputError: the image has another shape or type.
        """
        mph = float(np.asarray(observation["speed"]).item())
        command = drivable(self.policy(observation["image"], mph))
        throttle = self.speed.pedal(command, mph, self._steps / self.frame_rate)
        self._steps += 1
        return np.array([command.steering, throttle], np.float32)

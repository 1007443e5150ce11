"""A policy for the simulator's Gymnasium environments: observations in, actions out."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from zoo.checkpoints.command import Policy, PolicyFunction, as_policy
from zoo.drives.speed_controller import SpeedController, keep_limit, limit_pedal


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
            observation: `image`, uint8 [160, 320, 3] RGB, and `speed`, float [1] in mph.

        Raises:
            InputError: the image has another size or type.
        """
        mph = float(np.asarray(observation["speed"]).item())
        command = self.policy(observation["image"], mph)
        steering = 0.0 if math.isnan(command.steering) else command.steering
        now_s = self._steps / self.frame_rate
        throttle = self.speed.throttle(mph, steering, command.throttle, now_s, command.spread)
        throttle = limit_pedal(keep_limit(self.speed, throttle, mph, command.limit_mph), mph)
        self._steps += 1
        return np.array([min(max(steering, -1.0), 1.0), throttle], np.float32)

"""A Gymnasium environment as a world, and a policy that drives one."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from simulator.env import DrivingEnv
from zoo.base.errors import InputError
from zoo.base.rig import UDACITY
from zoo.checkpoints.command import Policy, PolicyFunction, as_policy
from zoo.drives.speed_controller import SpeedController
from zoo.worlds.scenario import Scenario
from zoo.worlds.world import State, World

if TYPE_CHECKING:
    import gymnasium  # slow import

# Keys of `info`, as the simulator's environments name them, and attributes of `State`.
KNOWN = {
    "cte": "cross_track_m",
    "width": "width_m",
    "distance": "distance_m",
    "lap": "lap",
    "hit": "contact",
}


class EnvironmentWorld(World):
    """A world of an environment whose action is steering and throttle, -1..1 each.

    Its observation is an image, or a dict with `image` and `speed` in mph. `info` may have the keys
    of `simulator.env`; what it lacks is unknown. After an intervention the environment is reset.

    Args:
        environment: environment to drive in.
        frame_rate: steps per second of simulated time.
    """

    def __init__(self, environment: "gymnasium.Env", frame_rate: float = 15.0) -> None:
        self.environment, self.frame_rate = environment, frame_rate
        self.rig = UDACITY if isinstance(environment.unwrapped, DrivingEnv) else None

    def reset(self, scenario: Scenario) -> State:
        """Begin an episode with the scenario's seed."""
        self.steps = 0
        self.observation, info = self.environment.reset(seed=scenario.seed)
        return self._state(info)

    def frame(self, camera: str = "center") -> np.ndarray:
        """Return the observed image, uint8 [H, W, 3] RGB."""
        image = self.observation
        if isinstance(image, dict):
            image = image["image" if camera == "center" else camera]
        return image

    def step(self, steering: float, throttle: float) -> State:
        """Take a step; the drive is done when the episode is."""
        self.steps += 1
        action = np.array([steering, throttle], np.float32)
        self.observation, _, terminated, truncated, info = self.environment.step(action)
        return self._state(info, done=terminated or truncated)

    def put_back(self, speed_mph: float) -> State:
        """Begin another episode, at the same time of the drive."""
        self.observation, info = self.environment.reset()
        return self._state(info)

    def close(self) -> None:
        """Close the environment."""
        self.environment.close()

    def facts(self, scenario: Scenario) -> dict[str, Any]:
        """Return the environment's name as the track, and the seed."""
        return super().facts(scenario) | {"track": scenario.track}

    def _state(self, info: dict[str, Any], done: bool = False) -> State:
        speed = info.get("speed_mph", float("nan"))
        if isinstance(self.observation, dict) and "speed" in self.observation:
            speed = np.asarray(self.observation["speed"]).item()
        known = {name: info[key] for key, name in KNOWN.items() if key in info}
        return State(self.steps / self.frame_rate, float(speed), **known, done=done)


def make_environment(scenario: Scenario) -> EnvironmentWorld:
    """Return the world of the environment that a scenario's `track` names.

    Raises:
        InputError: there is no such environment, or the name would import a module.
    """
    import gymnasium

    if ":" in scenario.track:  # a scenario can come from a file that somebody else wrote
        raise InputError(
            f"track={scenario.track}: names a module; register the environment in a file of your "
            "own, name the file with parts=, and the environment with track="
        )
    try:
        return EnvironmentWorld(gymnasium.make(scenario.track), scenario.frame_rate)
    except gymnasium.error.Error as error:
        raise InputError(f"track={scenario.track}: {error}") from None


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
        command = self.policy(observation["image"], mph)
        steering = 0.0 if math.isnan(command.steering) else command.steering
        command = replace(command, steering=min(max(steering, -1.0), 1.0))
        throttle = self.speed.pedal(command, mph, self._steps / self.frame_rate)
        self._steps += 1
        return np.array([command.steering, throttle], np.float32)

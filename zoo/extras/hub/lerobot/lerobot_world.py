"""A world with the names and units of a dataset that `drivezoo convert` wrote for LeRobot."""

import math
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

import zoo.simulator  # noqa: F401 - registers the environments
from zoo.base.rig import MPS_PER_MPH

GYM_ID = "drivezoo/LeRobot-v0"


class LeRobotWorld(gymnasium.Wrapper):
    """A world with the names of a converted dataset; a success stays on the road to the end.

    The end is that of the time, of `laps` or of an open road.

    Args:
        env: environment of drivezoo.
        seconds: length of an episode.
    """

    task = task_description = "follow the road"

    def __init__(self, env: gymnasium.Env, seconds: float) -> None:
        super().__init__(env)
        # LeRobot stops there, and needs the environment's own end before it for a success.
        self._max_episode_steps = math.ceil(seconds * env.metadata["render_fps"]) + 1
        pixels = spaces.Dict({"center": env.observation_space["image"]})  # type: ignore[index]
        state = spaces.Box(0, 200, (2,), np.float32)  # mph, m/s
        self.observation_space = spaces.Dict({"pixels": pixels, "agent_pos": state})
        # Steering, throttle, brake.
        self.action_space = spaces.Box(np.array([-1, -1, 0], np.float32), np.ones(3, np.float32))

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        """Begin an episode; LeRobot's options are not those of the environment."""
        observation, info = self.env.reset(seed=seed)
        return self._named(observation), info | {"is_success": False}

    def step(self, action: Any) -> Any:
        """Drive one frame."""
        steering, throttle, brake = np.clip(np.asarray(action, float), (-1, -1, 0), 1)
        action = np.array([steering, throttle - brake], np.float32).clip(-1, 1)
        observation, reward, terminated, truncated, info = self.env.step(action)
        inner: Any = self.unwrapped
        arrived = inner.world.is_complete(inner.laps or math.inf)
        stayed = (arrived or (truncated and not terminated)) and not info["off_road"]
        named = self._named(observation)
        return named, reward, terminated, truncated, info | {"is_success": bool(stayed)}

    def _named(self, observation: Any) -> dict[str, Any]:
        state = observation["speed"] * np.array([1, MPS_PER_MPH], np.float32)
        return {"pixels": {"center": observation["image"]}, "agent_pos": state}


def open_lerobot_world(task: str, seconds: float, **keys: Any) -> LeRobotWorld:
    """Return the environment of a task, such as `Lake-v0`; `keys` are those of `DrivingEnv`."""
    return LeRobotWorld(gymnasium.make(f"drivezoo/{task}", max_seconds=seconds, **keys), seconds)


gymnasium.register(GYM_ID, "zoo.extras.hub.lerobot.lerobot_world:open_lerobot_world")

"""A world of drivezoo as `--env.type=drivezoo` of `lerobot-eval` and `lerobot-train`.

LeRobot imports this module itself, with `--env.discover_packages_path=zoo.extras.hub.lerobot`.
Observation and action have the names and units of a dataset that `drivezoo convert` wrote.
"""

from dataclasses import dataclass, field
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from lerobot.configs.types import FeatureType, PolicyFeature
from lerobot.envs.configs import EnvConfig
from lerobot.utils.constants import ACTION, OBS_IMAGES, OBS_STATE

import zoo.simulator  # noqa: F401 - registers the environments
from zoo.base.rig import MPS_PER_MPH

GYM_ID = "drivezoo/LeRobot-v0"
RATE = 15  # steps per second


class LeRobotWorld(gymnasium.Wrapper):
    """A world with the names of a converted dataset; a success stays on the road to the end.

    Args:
        env: environment of drivezoo.
        seconds: length of an episode.
    """

    task = task_description = "follow the road"

    def __init__(self, env: gymnasium.Env, seconds: float) -> None:
        super().__init__(env)
        self.seconds, self._max_episode_steps = seconds, round(seconds * RATE)
        pixels = spaces.Dict({"center": env.observation_space["image"]})  # type: ignore[index]
        state = spaces.Box(0, 200, (2,), np.float32)  # mph, m/s
        self.observation_space = spaces.Dict({"pixels": pixels, "agent_pos": state})
        self.action_space = spaces.Box(-1, 1, (3,), np.float32)  # steering, throttle, brake

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        """Begin an episode; LeRobot's options are not those of the environment."""
        observation, info = self.env.reset(seed=seed)
        return self._named(observation), info | {"is_success": False}

    def step(self, action: Any) -> Any:
        """Drive one frame."""
        steering, throttle, brake = np.clip(np.asarray(action, float), -1, 1)
        action = np.array([steering, throttle - brake], np.float32).clip(-1, 1)
        observation, reward, terminated, truncated, info = self.env.step(action)
        stayed = bool(truncated and not terminated and not info["off_road"])
        named = self._named(observation)
        return named, reward, terminated, truncated, info | {"is_success": stayed}

    def _named(self, observation: Any) -> dict[str, Any]:
        state = observation["speed"] * np.array([1, MPS_PER_MPH], np.float32)
        return {"pixels": {"center": observation["image"]}, "agent_pos": state}


def open_lerobot_world(task: str, seconds: float, **keys: Any) -> LeRobotWorld:
    """Return the environment of a task, such as `Lake-v0`; `keys` are those of `DrivingEnv`."""
    return LeRobotWorld(gymnasium.make(f"drivezoo/{task}", max_seconds=seconds, **keys), seconds)


@EnvConfig.register_subclass("drivezoo")
@dataclass
class DrivezooEnv(EnvConfig):
    """Keys of `--env.type=drivezoo`.

    Attributes:
        task: name of an environment without `drivezoo/`.
        fps: steps per second of simulated time.
        seconds: length of an episode.
        observation_height, observation_width: pixels of the image.
        random_start: whether each seed begins at another place.
    """

    task: str | None = "Lake-v0"
    fps: int = RATE
    seconds: float = 30.0
    observation_height: int = 160
    observation_width: int = 320
    random_start: bool = True
    features: dict[str, PolicyFeature] = field(default_factory=dict)
    features_map: dict[str, str] = field(
        default_factory=lambda: {
            ACTION: ACTION,
            "agent_pos": OBS_STATE,
            "pixels/center": f"{OBS_IMAGES}.center",
        }
    )

    def __post_init__(self) -> None:
        """Add the features of action, state and image."""
        image = (self.observation_height, self.observation_width, 3)
        self.features[ACTION] = PolicyFeature(FeatureType.ACTION, (3,))
        self.features["agent_pos"] = PolicyFeature(FeatureType.STATE, (2,))
        self.features["pixels/center"] = PolicyFeature(FeatureType.VISUAL, image)

    @property
    def gym_id(self) -> str:
        """Return the environment's name in Gymnasium."""
        return GYM_ID

    @property
    def gym_kwargs(self) -> dict[str, Any]:
        """Return the arguments of `open_lerobot_world`."""
        return {
            "task": self.task,
            "seconds": self.seconds,
            "render_mode": "rgb_array",
            "random_start": self.random_start,
            "height": self.observation_height,
            "width": self.observation_width,
        }


gymnasium.register(GYM_ID, "zoo.extras.hub.lerobot.lerobot_env:open_lerobot_world")

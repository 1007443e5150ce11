"""A world of drivezoo as `--env.type=drivezoo` of `lerobot-eval` and `lerobot-train`.

LeRobot imports this module itself, with `--env.discover_packages_path=zoo.extras.hub.lerobot`.
Observation and action have the names and units of a dataset that `drivezoo convert` wrote.
"""

from dataclasses import dataclass, field
from typing import Any

from lerobot.configs.types import FeatureType, PolicyFeature
from lerobot.envs.configs import EnvConfig
from lerobot.utils.constants import ACTION, OBS_IMAGES, OBS_STATE

from zoo.extras.hub.lerobot.lerobot_world import GYM_ID


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
    fps: int = 15
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
            "frame_rate": self.fps,
            "render_mode": "rgb_array",
            "random_start": self.random_start,
            "height": self.observation_height,
            "width": self.observation_width,
        }

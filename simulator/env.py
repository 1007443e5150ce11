"""Gymnasium environments of the simulator: `Lake-v0`, `UdacityLake-v0`, and any track's file.

>>> import gymnasium, simulator
>>> env = gymnasium.make("Lake-v0", laps=1)
>>> observation, info = env.reset(seed=1)
>>> observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
>>> env.close()

Several at once, a process each (`reset(seed=7)` seeds them 7, 8, 9 ...), in a script with
`if __name__ == "__main__":`, since Panda3D's and PyTorch's threads do not survive a fork:

    gymnasium.make_vec("Lake-v0", 4, vectorization_mode="async", vector_kwargs={"context": "spawn"})
"""

import math
from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from simulator.rig import CAMERAS, FRAME_HEIGHT, FRAME_WIDTH, TOP_SPEED_MPH
from simulator.weather import Weather, read_weather
from simulator.world import Start, open_world
from zoo.base.errors import InputError

START_KEYS = {"distance", "cte", "heading_deg", "speed_mph"}
SECONDS_PER_LAP = 300.0  # the longest included track at 11 mph


class DrivingEnv(gymnasium.Env):
    """A car on a track, with one frame for each step.

    Observation: `image` (uint8 [160, 320, 3] RGB, the centre camera; with `cameras="all"` also
    `left` and `right`) and `speed` (float32 [1], mph). Action: float32 [2], steering (right
    positive) and throttle (negative brakes; it never reverses), -1..1 each. Reward: metres of
    progress along the lap; 0 off the road. An episode is terminated when `laps` are driven, at the
    end of an open road, or after `off_road_s` off the road. It is truncated after `max_seconds` of
    simulated time. `info` is `simulator.world.World.info`.

    Args:
        track: name of a track, or path of its YAML file.
        cameras: `center` or `all`.
        frame_rate: steps per second of simulated time, up to 50.
        delay_s: seconds from an action to the wheels.
        direction: `forward` or `backward`.
        weather: `clear`, `random` (drawn from each seed), settings such as `{"fog": 0.4}`, or a
            `Weather`.
        random_start: whether each seed begins at another place, up to 0.5 m off the centreline;
            otherwise episodes begin at the track's first point.
        laps: number of laps until the end; None for no end. An open road counts as one lap.
        max_seconds: simulated seconds until the end; None for 300 per lap, inf for no end.
        off_road_s: seconds allowed off the road; 0 ends the episode at the edge line.
        renderer: `auto`, `software` or `opengl`.
        quality: `full` or `simple`.
        render_mode: None or `rgb_array`.

    Raises:
        InputError: an argument is wrong, or no renderer opens on this machine.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 15}  # noqa: RUF012 - Gymnasium's own

    def __init__(
        self,
        track: str = "lake",
        cameras: str = "center",
        frame_rate: float = 15.0,
        delay_s: float = 0.0,
        direction: int | str = "forward",
        weather: str | Mapping[str, Any] | Weather = "clear",
        random_start: bool = True,
        laps: int | None = None,
        max_seconds: float | None = None,
        off_road_s: float = 1.0,
        renderer: str = "auto",
        quality: str = "full",
        render_mode: str | None = None,
    ) -> None:
        if cameras not in ("center", "all"):
            raise InputError(f"cameras={cameras}: must be center or all")
        if render_mode not in (None, "rgb_array"):
            raise InputError(f"render_mode={render_mode}: must be rgb_array, or None")
        if renderer == "none":
            raise InputError("renderer=none: observations need camera frames; use renderer=auto")
        limits = {"laps": laps, "max_seconds": max_seconds, "off_road_s": off_road_s}
        for name, value in limits.items():
            least = 1 if name == "laps" else 0
            if value is not None and not value >= least:
                raise InputError(f"{name}={value}: must be {least} or more; inf for no limit")
        self.metadata = {**self.metadata, "render_fps": frame_rate}
        self.weather, self.random_start = read_weather(weather), random_start
        self.render_mode, self.laps, self.off_road_s = render_mode, laps, off_road_s
        self.max_seconds = (laps or 1) * SECONDS_PER_LAP if max_seconds is None else max_seconds
        self.world = open_world(
            track, renderer, quality, frame_rate, delay_s, direction, reverses=False
        )
        self.images = {"image": "center"}
        if cameras == "all":
            self.images |= {camera: camera for camera in CAMERAS[1:]}
        image = spaces.Box(0, 255, (FRAME_HEIGHT, FRAME_WIDTH, 3), np.uint8)
        speed = spaces.Box(0, TOP_SPEED_MPH, (1,), np.float32)
        self.observation_space = spaces.Dict({**dict.fromkeys(self.images, image), "speed": speed})
        self.action_space = spaces.Box(-1, 1, (2,), np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Begin an episode.

        Args:
            seed: random seed of start, weather and sensor noise.
            options: start of the episode: `distance` and `cte` in metres, `heading_deg`,
                `speed_mph`, and `weather`; each is optional.

        Raises:
            InputError: an option is unknown, or its value is not allowed.
        """
        super().reset(seed=seed)
        options = dict(options or {})
        weather = read_weather(options.pop("weather", self.weather))
        if unknown := set(options) - START_KEYS:
            known = ", ".join(sorted(START_KEYS | {"weather"}))
            raise InputError(f"reset: unknown option {unknown.pop()}; available: {known}")
        start = {}
        if self.random_start:
            start["distance"] = self.world.draw_distance(self.np_random)
            start["cte"] = self.np_random.uniform(-0.5, 0.5)
        world_seed = int(self.np_random.integers(2**31))
        begin = Start(**{**start, **options})
        if not 0 <= begin.speed_mph <= TOP_SPEED_MPH:
            raise InputError(f"speed_mph={begin.speed_mph}: must be in 0..{TOP_SPEED_MPH:g}")
        self.world.reset(world_seed, begin, weather)
        self.off_since: float | None = None
        return self._observation(), self.world.info()

    def step(
        self, action: np.ndarray
    ) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        """Advance by one frame; actions beyond -1..1 are clamped.

        Raises:
            InputError: the action is not two finite numbers.
        """
        world, before = self.world, self.world.travelled
        action = np.asarray(action, float)
        if action.shape != (2,) or not np.isfinite(action).all():
            raise InputError(f"action={action.tolist()}: must be two finite numbers")
        world.step(*action.tolist())
        if not world.off_road:
            self.off_since = None
        elif self.off_since is None:
            self.off_since = world.time
        lost = self.off_since is not None and world.time - self.off_since >= self.off_road_s
        arrived = world.is_complete(math.inf if self.laps is None else self.laps)
        late = world.time >= self.max_seconds
        reward = 0.0 if world.off_road else world.travelled - before
        return self._observation(), reward, lost or arrived, late, world.info()

    def render(self) -> np.ndarray | None:
        """Return the last frame, uint8 [160, 320, 3], RGB, or None without a render mode."""
        return self._image.copy() if self.render_mode else None

    def close(self) -> None:
        """Close the renderer; a second call has no effect."""
        if self.world.renderer is not None:
            self.world.renderer.close()
            self.world.renderer = None

    def _observation(self) -> dict[str, np.ndarray]:
        frames = {key: self.world.frame(camera) for key, camera in self.images.items()}
        self._image = frames["image"]
        return {**frames, "speed": np.array([self.world.car.speed_mph], np.float32)}

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
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from simulator.errors import SimulatorError
from simulator.rig import CAMERAS, FRAME_HEIGHT, FRAME_WIDTH, TOP_SPEED_MPH
from simulator.weather import CLEAR, Weather
from simulator.world import Start, open_world

START_KEYS = {"distance", "cte", "heading_deg", "speed_mph"}


class DrivingEnv(gymnasium.Env):
    """A car on a track, with one frame for each step.

    Observation: `image` (uint8 [160, 320, 3] RGB, the centre camera; with `cameras="all"` also
    `left` and `right`) and `speed` (float32 [1], mph). Action: float32 [2], steering (right
    positive) and throttle (negative brakes), -1..1 each. Reward: metres of progress along the lap;
    0 off the road. An episode is terminated when `laps` are driven, at the end of an open road, or
    after `off_road_s` off the road. It is truncated after `max_seconds` of simulated time. `info`
    is `simulator.world.World.info`.

    Args:
        track: name of a track, or path of its YAML file.
        cameras: `center` or `all`.
        frame_rate: steps per second of simulated time, up to 50.
        delay_s: seconds from an action to the wheels.
        direction: 1 (forward) or -1 (backward).
        weather: `clear`, `random` (drawn from each seed), or a `Weather`.
        random_start: whether episodes begin at a random place, up to 0.5 m off the centreline.
        laps: number of laps until the end; None for no end. An open road counts as one lap.
        max_seconds: simulated seconds until the end; None for no end.
        off_road_s: seconds allowed off the road; 0 ends the episode at the edge line.
        renderer: `auto`, `software` or `opengl`.
        quality: `full` or `simple`.
        render_mode: None or `rgb_array`.

    Raises:
        SimulatorError: an argument is wrong, or no renderer opens on this machine.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 15}  # noqa: RUF012 - Gymnasium's own

    def __init__(
        self,
        track: str = "lake",
        cameras: str = "center",
        frame_rate: float = 15.0,
        delay_s: float = 0.0,
        direction: int = 1,
        weather: str | Weather = "clear",
        random_start: bool = False,
        laps: int | None = None,
        max_seconds: float | None = None,
        off_road_s: float = 1.0,
        renderer: str = "auto",
        quality: str = "full",
        render_mode: str | None = None,
    ) -> None:
        if cameras not in ("center", "all"):
            raise SimulatorError(f"cameras={cameras}: must be center or all")
        if render_mode not in (None, "rgb_array"):
            raise SimulatorError(f"render_mode={render_mode}: must be rgb_array, or None")
        if renderer == "none":
            raise SimulatorError(
                "renderer=none: observations need camera frames; use renderer=auto"
            )
        for name, value, least in (("laps", laps, 1), ("max_seconds", max_seconds, 0)):
            if value is not None and not value >= least:
                raise SimulatorError(f"{name}={value}: must be {least} or more, or None")
        if not off_road_s >= 0:
            raise SimulatorError(f"off_road_s={off_road_s}: must be 0 or more; inf for no limit")
        self.metadata = {**self.metadata, "render_fps": frame_rate}
        self.weather, self.random_start, self.render_mode = (
            _weather(weather),
            random_start,
            render_mode,
        )
        self.laps, self.max_seconds, self.off_road_s = laps, max_seconds, off_road_s
        self.world = open_world(track, renderer, quality, frame_rate, delay_s, direction)
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
            SimulatorError: an option is unknown, or its value is not allowed.
        """
        super().reset(seed=seed)
        options = dict(options or {})
        weather = _weather(options.pop("weather", self.weather))
        if unknown := set(options) - START_KEYS:
            known = ", ".join(sorted(START_KEYS | {"weather"}))
            raise SimulatorError(f"reset: unknown option {unknown.pop()}; available: {known}")
        start = {}
        if self.random_start:
            start = {
                "distance": self.world.draw_distance(self.np_random),
                "cte": self.np_random.uniform(-0.5, 0.5),
            }
        world_seed = int(self.np_random.integers(2**31))
        begin = Start(**{**start, **options})
        if not 0 <= begin.speed_mph <= TOP_SPEED_MPH:
            raise SimulatorError(f"speed_mph={begin.speed_mph}: must be in 0..{TOP_SPEED_MPH:g}")
        self.world.reset(world_seed, begin, weather)
        self.off_since: float | None = None
        return self._observation(), self.world.info()

    def step(
        self, action: np.ndarray
    ) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        """Advance by one frame; actions beyond -1..1 are clamped.

        Raises:
            SimulatorError: the action is not two finite numbers.
        """
        world, before = self.world, self.world.travelled
        action = np.asarray(action, float)
        if action.shape != (2,) or not np.isfinite(action).all():
            raise SimulatorError(f"action={action.tolist()}: must be two finite numbers")
        world.step(*action.tolist())
        if not world.off_road:
            self.off_since = None
        elif self.off_since is None:
            self.off_since = world.time
        lost = self.off_since is not None and world.time - self.off_since >= self.off_road_s
        arrived = world.is_complete(math.inf if self.laps is None else self.laps)
        late = self.max_seconds is not None and world.time >= self.max_seconds
        reward = 0.0 if world.off_road else world.travelled - before
        return self._observation(), reward, lost or arrived, late, world.info()

    def render(self) -> np.ndarray | None:
        """Return the last frame, uint8 [160, 320, 3], RGB, or None without a render mode."""
        return self._image.copy() if self.render_mode else None

    def close(self) -> None:
        """Close the renderer; a second call has no effect."""
        if self.world.pictures is not None:
            self.world.pictures.close()
            self.world.pictures = None

    def _observation(self) -> dict[str, np.ndarray]:
        frames = {key: self.world.frame(camera) for key, camera in self.images.items()}
        self._image = frames["image"]
        return {**frames, "speed": np.array([self.world.car.speed_mph], np.float32)}


def _weather(given: str | Weather) -> str | Weather:
    """Return a weather as `World.reset` takes it."""
    if isinstance(given, Weather) or given == "random":
        return given
    if given != "clear":
        raise SimulatorError(f"weather={given}: must be clear, random or a Weather")
    return CLEAR

"""Gymnasium environments of the simulator: `drivezoo/Lake-v0`, `drivezoo/Alpine-v0`, ...

>>> import gymnasium, drivezoo
>>> env = gymnasium.make("drivezoo/Lake-v0", laps=1)
>>> observation, info = env.reset(seed=1)
>>> observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
>>> env.close()

Several at once, a process each (`reset(seed=7)` seeds them 7, 8, 9 ...), in a script with
`if __name__ == "__main__":`, since Panda3D's and PyTorch's threads do not survive a fork:

    spawn = {"context": "spawn"}
    gymnasium.make_vec("drivezoo/Lake-v0", 4, vectorization_mode="async", vector_kwargs=spawn)
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from zoo.base.errors import InputError, library_errors
from zoo.base.key_values import constructed, convert
from zoo.base.rig import UDACITY
from zoo.simulator import udacity_car as rig
from zoo.simulator.reward import REWARDS, TERMINATIONS, Info, Reward, Termination, named_function
from zoo.simulator.simulated_world import Start, World, open_world
from zoo.simulator.track_names import ANY_ROAD
from zoo.simulator.weather import Weather, read_weather
from zoo.simulator.world_settings import Quality

START_KEYS = {"distance", "cte", "heading_deg", "speed_mph"}
SECONDS_PER_LAP = 300.0  # the longest included track at 11 mph


class DrivingEnv(gymnasium.Env):
    """A car on a track, with one frame for each step.

    Observation: `image` (uint8 [height, width, 3] RGB, the centre camera; with `cameras="all"` also
    `left` and `right`) and `speed` (float32 [1], mph). Action: float32 [2], steering (right
    positive) and throttle (negative brakes; it never reverses), -1..1 each. An episode is
    terminated when `laps` are driven, at the end of an open road, or by `termination`. It is
    truncated after `max_seconds` of simulated time. `info` is that of `World.info`, and
    `width` of the road in metres, `hit` (whether a wall stops the car), `driven_m` (metres of
    progress) and `furthest` (the largest `progress` so far).

    Args:
        track: name of a track, path of its YAML file, `alpine:17` for one road of a family, or
            `alpine:*` for another road at each reset, the one with the number of the seed.
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
        quality: `full`, `fast` or `simple`.
        render_mode: None or `rgb_array`.
        width, height: pixels of an image, 8..1024 each.
        vertical_fov_deg: angle of view from the top to the bottom of an image, 1..170.
        reward: `progress` (metres along the lap; 0 off the road), `donkeycar`, `carracing`, or a
            function of the `info` before and after a step, and of whether the episode is
            terminated, that returns a number. See `zoo.simulator.reward`.
        termination: `off_road` (after `off_road_s`), `donkeycar`, `carracing`, or a function of
            `info` that returns whether the episode ends.

    Raises:
        InputError: an argument is wrong.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 15}  # noqa: RUF012 - Gymnasium's own

    def __init__(
        self,
        track: str | Path = "lake",
        cameras: str = "center",
        frame_rate: float = 15,  # LeRobot's videos need a whole number
        delay_s: float = 0.0,
        direction: int | str = "forward",
        weather: str | Mapping[str, Any] | Weather = "clear",
        random_start: bool = True,
        laps: int | None = None,
        max_seconds: float | None = None,
        off_road_s: float = 1.0,
        renderer: str = "auto",
        quality: Quality = "full",
        render_mode: str | None = None,
        width: int = rig.FRAME_WIDTH,
        height: int = rig.FRAME_HEIGHT,
        vertical_fov_deg: float = rig.VERTICAL_FOV_DEG,
        reward: str | Reward = "progress",
        termination: str | Termination = "off_road",
    ) -> None:
        if cameras not in ("center", "all"):
            raise InputError(f"cameras={cameras}: must be center or all")
        if render_mode not in (None, "rgb_array"):
            raise InputError(f"render_mode={render_mode}: must be rgb_array, or None")
        if renderer == "none":
            raise InputError("renderer=none: observations need camera frames; use renderer=auto")
        for name, value, least, most in (
            ("laps", 1 if laps is None else laps, 1, math.inf),
            ("max_seconds", 0 if max_seconds is None else max_seconds, 0, math.inf),
            ("off_road_s", off_road_s, 0, math.inf),
            ("width", width, *rig.PIXELS),
            ("height", height, *rig.PIXELS),
            ("vertical_fov_deg", vertical_fov_deg, *rig.FOV_DEG),
        ):
            kind = int | np.integer if most == rig.PIXELS[1] else int | float | np.number
            if not isinstance(value, kind) or not least <= value <= most:
                whole = ", a whole number" * (most == rig.PIXELS[1])
                limit = "or more; inf for no limit" if most == math.inf else f"to {most:g}{whole}"
                raise InputError(f"{name}={value}: must be {least:g} {limit}")
        self.metadata = {**self.metadata, "render_fps": frame_rate}
        self.random_start = convert("random_start", bool, random_start)
        self.weather = read_weather(weather)
        self.render_mode, self.laps, self.off_road_s = render_mode, laps, off_road_s
        self.max_seconds = (laps or 1) * SECONDS_PER_LAP if max_seconds is None else max_seconds
        self.reward = named_function("reward", reward, REWARDS)
        ends = {"off_road": self._is_lost, **TERMINATIONS}
        self.termination = named_function("termination", termination, ends)
        lens = {"size": (width, height), "vertical_fov_deg": vertical_fov_deg}
        cameras_of = {name: camera.changed(**lens) for name, camera in UDACITY.cameras.items()}
        self.rig, self.renderer = replace(UDACITY, cameras=cameras_of), renderer
        self.settings: dict[str, Any] = {
            "quality": quality,
            "frame_rate": frame_rate,
            "delay_s": delay_s,
            "direction": direction,
            "reverses": False,
            "rig": self.rig,
        }
        name, _, number = str(track).rpartition(":")
        self.family = name if number == ANY_ROAD else ""
        self.track = f"{name}:0" if self.family else str(track)
        # `reset` opens the renderer, so that a process that only describes a vector has none.
        self.world = open_world(self.track, "none", **self.settings)
        sides = rig.CAMERAS[1:] if cameras == "all" else ()
        self.images = {"image": "center", **{camera: camera for camera in sides}}
        image = spaces.Box(0, 255, (height, width, 3), np.uint8)
        speed = spaces.Box(0, rig.TOP_SPEED_MPH, (1,), np.float32)
        self.observation_space = spaces.Dict({**dict.fromkeys(self.images, image), "speed": speed})
        self.action_space = spaces.Box(-1, 1, (2,), np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Begin an episode.

        Args:
            seed: random seed of start, weather and sensor noise, and number of the road of a
                family; None draws the next.
            options: start of the episode: `distance` and `cte` in metres, `heading_deg`,
                `speed_mph`, `weather`, and of a family `seed`, the road's number; each is optional.

        Raises:
            InputError: an option is unknown, its value is not allowed, or no renderer opens on this
                machine.
        """
        seed = convert("seed", int | None, seed)
        super().reset(seed=seed)
        options = dict(options or {})
        weather = read_weather(options.pop("weather", self.weather))
        if self.family:
            # A road's number has 31 bits, and seeds that stable-baselines3 draws have 32.
            drawn = int(self.np_random.integers(2**31)) if seed is None else seed % 2**31
            self._open(f"{self.family}:{options.pop('seed', drawn)}")
        elif self.world.renderer is None:
            self._open(self.track)
        if unknown := set(options) - START_KEYS:
            names = ", ".join(sorted({*START_KEYS, "weather", *["seed"] * bool(self.family)}))
            raise InputError(f"reset: unknown option {unknown.pop()}; available: {names}")
        start = {}
        if self.random_start:
            start["distance"] = self.world.draw_distance(self.np_random)
            start["cte"] = self.np_random.uniform(-0.5, 0.5)
        world_seed = int(self.np_random.integers(2**31))
        self.world.reset(world_seed, Start(**{**start, **constructed(Start, options)}), weather)
        self.off_since: float | None = None
        self.info = self._about(0.0)
        return self._observation(), dict(self.info)

    def step(
        self, action: np.ndarray
    ) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        """Advance by one frame; actions beyond -1..1 are clamped.

        Raises:
            InputError: the action is not two finite numbers, or no episode has begun.
        """
        world = self._begun()
        with library_errors("action", "is no array of numbers", "give two finite numbers"):
            action = np.asarray(action, float)
        if action.shape != (2,) or not np.isfinite(action).all():
            raise InputError(f"action={action.tolist()}: must be two finite numbers")
        world.step(*action.tolist())
        since = world.time if self.off_since is None else self.off_since
        self.off_since = since if world.off_road else None
        before, self.info = self.info, self._about(self.info["furthest"])
        arrived = world.is_complete(math.inf if self.laps is None else self.laps)
        terminated = arrived or bool(self.termination(self.info))
        reward = float(self.reward(before, self.info, terminated))
        truncated = world.time >= self.max_seconds
        return self._observation(), reward, terminated, truncated, dict(self.info)

    def render(self) -> np.ndarray | None:
        """Return the last frame, uint8 [height, width, 3], RGB, or None without a render mode."""
        return self._image.copy() if self.render_mode and self._begun() else None

    def close(self) -> None:
        """Close the renderer; a second call has no effect."""
        self.world.close()

    def _open(self, track: str) -> None:
        """Open a world with frames, unless it is the present one."""
        if track != self.track or self.world.renderer is None:
            self.close()
            self.world = open_world(track, self.renderer, **self.settings)
            self.track = track

    def _begun(self) -> World:
        if self.world.renderer is None:
            raise InputError("no episode runs in this environment; call its reset first")
        return self.world

    def _is_lost(self, info: Info) -> bool:
        return self.off_since is not None and self.world.time - self.off_since >= self.off_road_s

    def _about(self, furthest: float) -> Info:
        world, info = self.world, self.world.info()
        return info | {
            "width": world.place.width,
            "hit": world.at_wall,
            "driven_m": world.travelled,
            "furthest": max(furthest, info["progress"]),
        }

    def _observation(self) -> dict[str, np.ndarray]:
        frames = {key: self.world.frame(camera) for key, camera in self.images.items()}
        self._image = frames["image"].copy()  # a wrapper may change what it gets
        return {**frames, "speed": np.array([self.world.car.speed_mph], np.float32)}

"""A world: a track, a car and its cameras, in steps of simulated time."""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field

from zoo.base.errors import InputError, UsageError
from zoo.base.rig import UDACITY, Rig
from zoo.simulator.car import OFF_ROAD, ROAD, Car
from zoo.simulator.track import SOLID_M, Place, Track
from zoo.simulator.track_file import read_track
from zoo.simulator.udacity_car import PHYSICS_STEP_S, TOP_SPEED_MPH, WHEEL_TRACK_M
from zoo.simulator.weather import CLEAR, Weather, random_weather
from zoo.simulator.world_settings import Quality, WorldSettings

if TYPE_CHECKING:
    from zoo.simulator.renderer import Renderer

AT_END_M = 1e-3  # more than rounding errors
ROAD_AHEAD_M = 100.0  # smallest length of open road ahead of a random start
SCRAPE = 0.9  # factor on the speed for each step of contact with a wall


@dataclass(frozen=True)
class Start:
    """The begin of a drive.

    Args:
        distance: metres along the road; None for its begin: the first point, or the last point of
            an open road that is driven backward.
        cte: metres right of the centreline.
        heading_deg: degrees to the right of the road's heading.
        speed_mph: speed in mph.
    """

    distance: float | None = None
    cte: float = 0.0
    heading_deg: float = 0.0
    speed_mph: Annotated[float, Field(ge=0, le=TOP_SPEED_MPH)] = 0.0


class World:
    """A track with a car on it, in simulated time.

    It is deterministic: with the same renderer, the same seed, start and commands give identical
    frames. It never reads the wall clock.

    Args:
        track: track to drive on.
        renderer: renderer of the track; None for a world without frames.
        frame_rate: frames per second of simulated time, up to 50.
        delay_s: seconds from a command to the wheels, 0..2.
        direction: forward (or 1), as in the file, or backward (or -1).
        reverses: see `zoo.simulator.car.Car`.
        loop: seconds from each frame to the next, and from a frame to the arrival of its command;
            repeated, from a place that the seed draws. None for a constant frame rate.
    """

    def __init__(
        self,
        track: Track,
        renderer: "Renderer | None" = None,
        frame_rate: float = 15.0,
        delay_s: float = 0.0,
        direction: int | str = 1,
        reverses: bool = True,
        loop: Sequence[tuple[float, float]] | None = None,
    ) -> None:
        settings = WorldSettings(frame_rate=frame_rate, delay_s=delay_s, direction=direction)
        settings.check()
        self.track, self.renderer, self.direction = track, renderer, int(settings.direction)
        self.loop = tuple(loop or [(1 / frame_rate, 0.0)])
        self._ends_s = np.cumsum([0.0, *(period for period, _ in self.loop)]).tolist()
        self.frame_s = self._ends_s[-1] / len(self.loop)  # on average
        self.delay_steps = round(delay_s / PHYSICS_STEP_S)
        self.car = Car(reverses)
        self.weather = CLEAR
        self.reset(0)

    def reset(self, seed: int, start: Start | None = None, weather: Weather | str = CLEAR) -> None:
        """Begin a drive; draw the weather from the seed if it is "random"."""
        if seed < 0:
            raise InputError(f"seed={seed}: must be 0 or more")
        rng = np.random.default_rng(seed)
        # Of a text, `read_weather` leaves "random" alone.
        self.weather = weather if isinstance(weather, Weather) else random_weather(rng)
        if self.renderer is not None:
            self.renderer.set_weather(self.weather, int(rng.integers(2**31)))
        start = start or Start()
        self.steps = self.frames = self.lap = 0
        self._first = int(np.random.default_rng((seed, 2)).integers(len(self.loop)))
        self.travelled = 0.0
        self.put_back(start)
        asked = start.distance or 0.0
        if self.at_end or not (self.track.closed or 0 <= asked <= self.track.length):
            raise UsageError(
                f"start={asked:g}: is not between the ends of the open road "
                f"{self.track.name}; start nearer to {self.track.begin(self.direction):.0f} m"
            )

    def put_back(self, start: Start) -> None:
        """Put the car at a place during a drive."""
        for value in vars(start).values():
            if value is not None and not np.isfinite(value):
                raise InputError(f"start={value}: must be a finite number")
        begin = self.track.begin(self.direction)
        distance = begin if start.distance is None else self.track.wrap(start.distance)
        heading = float(self.track.heading_at(distance))
        right = np.array([np.sin(heading), -np.cos(heading)]) * self.direction
        x, y = self.track.at(distance)[:2] + start.cte * right
        if self.direction < 0:
            heading += np.pi
        self.car.place(x, y, heading - np.radians(start.heading_deg), start.speed_mph)
        self._command = (0.0, 0.0)
        self._sent: deque[tuple[int, tuple[float, float]]] = deque()
        self.place = self.track.locate(x, y, distance)
        self.at_wall = False

    def step(self, steering: float, throttle: float) -> None:
        """Advance by one frame."""
        _, late_s = self.loop[(self._first + self.frames) % len(self.loop)]
        arrives = self.steps + round(late_s / PHYSICS_STEP_S) + self.delay_steps
        if self._sent:  # commands arrive in their order
            arrives = max(arrives, self._sent[-1][0])
        self._sent.append((arrives, (steering, throttle)))
        self.frames += 1
        until = round(self._loop_s(self.frames) / PHYSICS_STEP_S)
        while self.steps < until:
            self.steps += 1
            while self._sent and self._sent[0][0] < self.steps:
                self._command = self._sent.popleft()[1]
            before = self.place
            ahead = math.cos(self.car.heading - before.heading)
            surface = ROAD if not self.off_road else OFF_ROAD
            self.car.step(*self._command, before.grade * ahead, surface)
            self.place = self.track.locate(self.car.x, self.car.y, before.distance)
            self._keep_within_walls()
            self._count(before)

    @property
    def time(self) -> float:
        """Return the simulated seconds since `reset`."""
        return self.steps * PHYSICS_STEP_S

    @property
    def cte(self) -> float:
        """Return the metres right of the centreline, seen in the driving direction."""
        return self.place.cte * self.direction

    @property
    def heading_error(self) -> float:
        """Return the car's heading to the right of the road's, in radians, in (-pi, pi]."""
        road = self.place.heading + (np.pi if self.direction < 0 else 0)
        return float(np.angle(np.exp(1j * (road - self.car.heading))))

    @property
    def off_road(self) -> bool:
        """Return whether the car's middle is beyond the edge line, or a wall stops the car."""
        return self.at_wall or abs(self.place.cte) > self.place.width / 2

    @property
    def at_end(self) -> bool:
        """Return whether the car is at or beyond the end of an open road."""
        end = self.track.begin(-self.direction)
        return not self.track.closed and abs(self.place.distance - end) < AT_END_M

    def drive_m(self, laps: float) -> float:
        """Return the length of a drive in metres; on an open road more than 1 lap counts as 1."""
        return (laps if self.track.closed else min(laps, 1.0)) * self.track.length

    def is_complete(self, laps: float) -> bool:
        """Return whether laps are driven since `reset`, or an open road has ended."""
        return self.at_end or self.travelled >= self.drive_m(laps)

    def draw_distance(self, rng: np.random.Generator) -> float:
        """Return a random start, in metres, with enough of an open road ahead."""
        length = self.track.length
        if self.track.closed:
            return rng.uniform(0, length)
        drawn = rng.uniform(0, length - min(ROAD_AHEAD_M, length / 2))
        return drawn if self.direction > 0 else length - drawn

    def info(self) -> dict:
        """Return figures for scoring; `progress` is the laps driven, fractions included."""
        return {
            "cte": self.cte,
            "heading_error": self.heading_error,
            "progress": self.travelled / self.track.length,
            "lap": self.lap,
            "off_road": self.off_road,
            "distance": self.place.distance,
            "time": self.time,
            "speed_mph": self.car.speed_mph,
        }

    def frame(self, camera: str = "center") -> np.ndarray:
        """Return a camera's frame: uint8 [H, W, 3], RGB; 160 x 320 from Udacity's rig."""
        return self.drawing().frame(self.pose(), camera, self.frames)

    def drawing(self) -> "Renderer":
        """Return the renderer.

        Raises:
            InputError: the world has none.
        """
        if self.renderer is None:
            raise InputError("this world has no renderer; open it with renderer=auto")
        return self.renderer

    def close(self) -> None:
        """Close the renderer, if there is one."""
        if self.renderer is not None:
            self.renderer.close()
            self.renderer = None

    def pose(self) -> tuple[float, float, float, float, float]:
        """Return the car's x, y, z in metres, and its heading and upward pitch in radians."""
        pitch = float(np.arctan(self.place.grade * np.cos(self.car.heading - self.place.heading)))
        return self.car.x, self.car.y, self.place.z, self.car.heading, pitch

    def _loop_s(self, frames: int) -> float:
        """Return the seconds from `reset` to a frame."""
        repeated, part = divmod(self._first + frames, len(self.loop))
        return repeated * self._ends_s[-1] + self._ends_s[part] - self._ends_s[self._first]

    def _keep_within_walls(self) -> None:
        verge = self.track.verge_at(self.place.distance)
        kind, side = (verge.right, 1) if self.place.cte > 0 else (verge.left, -1)
        room = self.place.width / 2 + SOLID_M.get(kind, math.inf) - WHEEL_TRACK_M / 2
        # A car against a wall is placed exactly at it; the 0.01 m keep it in contact.
        self.at_wall = abs(self.place.cte) > room - 0.01
        over = (abs(self.place.cte) - room) * side
        if not self.at_wall or over * side <= 0:
            return
        heading = self.place.heading
        self.car.x -= over * np.sin(heading)
        self.car.y += over * np.cos(heading)
        self.car.ahead_mps *= SCRAPE
        self.car.left_mps = 0.0
        self.place = self.track.locate(self.car.x, self.car.y, self.place.distance)

    def _count(self, before: Place) -> None:
        length, moved = self.track.length, self.place.distance - before.distance
        if self.track.closed:
            moved = (moved + length / 2) % length - length / 2
        self.travelled += moved * self.direction
        driven = self.travelled if self.track.closed else self.travelled + AT_END_M
        self.lap = max(self.lap, int(driven // length))


def open_world(
    track: str | Track = "lake",
    renderer: "str | Renderer" = "auto",
    quality: Quality = "full",
    frame_rate: float = 15.0,
    delay_s: float = 0.0,
    direction: int | str = 1,
    seed: int = 0,
    reverses: bool = True,
    rig: Rig = UDACITY,
    loop: Sequence[tuple[float, float]] | None = None,
) -> World:
    """Open a world of a track, or of its name or file; `renderer="none"` gives no frames.

    The frames are those of the rig's cameras; the car is always Udacity's.

    Raises:
        InputError: there is no such track or renderer, or a value is not allowed.
    """
    course = read_track(track) if isinstance(track, str) else track
    opened = None if isinstance(renderer, str) else renderer
    if isinstance(renderer, str) and renderer != "none":
        from zoo.simulator.renderer import Renderer  # slow import: a training only checks worlds

        opened = Renderer(course, renderer, quality, rig)
    world = World(course, opened, frame_rate, delay_s, direction, reverses, loop)
    world.reset(seed)
    return world

"""The expert: a driver that follows the road by the world's exact state, without a camera."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field

from zoo.base.errors import InputError
from zoo.base.key_values import check_values
from zoo.base.rig import MPS_PER_MPH
from zoo.simulator.car import DRAG_PER_S, DRIVE_N, GRAVITY_MPS2, REVERSE_BELOW_MPH
from zoo.simulator.simulated_world import World
from zoo.simulator.track import Track
from zoo.simulator.udacity_car import (
    MASS_KG,
    MAX_STEERING_DEG,
    PHYSICS_STEP_S,
    TOP_SPEED_MPH,
    WHEELBASE_M,
)

SLOWEST_MPS = 3.0
THROTTLE_PER_MPS = 0.4  # throttle per m/s below the wanted speed


@dataclass(frozen=True)
class ExpertSettings:
    """Settings of the expert.

    Args:
        speed_mph: speed on straights in mph, 8..30; 30 holds full throttle, as a person does.
        offset_m: line to follow, in metres right of the centreline.
        noise: size of random sways off the line, 0..1; 1 is up to 60 % of the road's half width.
        sway_every_m: mean distance from the end of a sway to the next one, in metres.
        cornering_mps2: largest sideways acceleration; the expert slows down for sharper bends.
        braking_mps2: deceleration before such bends.
        steering_per_s: largest change of steering, -1..1, per second.
        reaction_s: delay of its steering in seconds, added to the car's delay.
        seed: random seed of the sways.
    """

    speed_mph: Annotated[float, Field(ge=REVERSE_BELOW_MPH + 3, le=TOP_SPEED_MPH)] = TOP_SPEED_MPH
    offset_m: Annotated[float, Field(ge=-5, le=5)] = 0.0
    noise: Annotated[float, Field(ge=0, le=1)] = 0.0
    sway_every_m: Annotated[float, Field(ge=30, le=1e4)] = 60.0
    cornering_mps2: Annotated[float, Field(ge=0.5, le=8)] = 5.0
    braking_mps2: Annotated[float, Field(ge=0.5, le=6)] = 3.0
    steering_per_s: Annotated[float, Field(ge=1, le=50)] = 4.0
    reaction_s: Annotated[float, Field(ge=0, le=1)] = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        check_values(self)


class Expert:
    """A driver of worlds: `expert(world) -> (steering, throttle)`, once for each frame.

    Steering is the road's curvature ahead plus a correction towards the line. The bends ahead limit
    the speed. With noise the expert sways off its line at random and returns. `recording` is False
    while it moves away, because a network should learn only the way back.

    Args:
        track: track to drive on.
        settings: settings of the expert.
    """

    def __init__(self, track: Track, settings: ExpertSettings | None = None) -> None:
        self.track, self.settings = track, settings or ExpertSettings()
        room = track.widths.min() / 2 - 1
        if abs(self.settings.offset_m) > room:
            raise InputError(
                f"expert: offset_m={self.settings.offset_m:g}: must be in "
                f"{-room:.1f}..{room:.1f} on this road"
            )
        self._limits = {way: speed_limits(track, self.settings, way) for way in (1, -1)}
        self.reset(self.settings.seed)

    def reset(self, seed: int) -> None:
        """Begin a drive with straight wheels and the sways of a seed."""
        self.rng = np.random.default_rng(seed)
        self.steering = 0.0
        self.recording = True
        # Begin and end in metres driven, size in metres.
        self._sway: tuple[float, float, float] | None = None
        self._next_sway: float | None = None

    def __call__(self, world: World) -> tuple[float, float]:
        """Return steering (right positive) and throttle (braking negative), -1..1, for a frame."""
        wish = np.clip(self._steering(world, self._line(world)), -1, 1)
        change = self.settings.steering_per_s * world.frame_s
        self.steering = float(np.clip(wish, self.steering - change, self.steering + change))
        return self.steering, self._throttle(world)

    def _line(self, world: World) -> float:
        """Return the line to follow, in metres right of the centreline; begin and end sways."""
        usual, driven = self.settings.offset_m, world.travelled
        if self.settings.noise == 0:
            return usual
        if self._next_sway is None:
            # At least 25 m later, the length of the way back from the last one.
            self._next_sway = driven + 25 + self.rng.exponential(self.settings.sway_every_m - 25)
        if self._sway is None and driven >= self._next_sway:
            room = 0.6 * world.place.width / 2 * self.settings.noise
            far = room * self.rng.uniform(0.4, 1) * self.rng.choice([-1, 1])
            self._sway = driven, driven + self.rng.uniform(10, 25), far
            self.recording = False
        if self._sway is None:
            return usual
        begin, end, far = self._sway
        # The car follows its line late, so it gets 10 m more to reach it.
        if driven >= end + 10 or world.cte / far >= 0.95:
            self._sway = self._next_sway = None
            self.recording = True
            return usual
        part = np.clip((driven - begin) / (end - begin), 0, 1)
        return usual + (far - usual) * part * part * (3 - 2 * part)

    def _steering(self, world: World, line: float) -> float:
        """Return steering for the line's curvature ahead and a second-order return to the line."""
        car, way, track = world.car, world.direction, self.track
        speed = max(car.ahead_mps, 1.0)
        # A command takes effect after the world's delay and lasts for a frame.
        late = world.delay_steps * PHYSICS_STEP_S + world.frame_s / 2 + self.settings.reaction_s
        # The direction of motion, not of the car: they differ in bends, where the car slips.
        course = world.heading_error - float(np.arctan2(car.left_mps, speed))
        distance = world.place.distance
        here = way * float(track.curvature_at(distance))
        turning = (car.yaw_rate - speed * here * np.cos(course)) * late
        off = world.cte - line + speed * late * np.sin(course - turning / 2)
        course -= turning
        reach = 3.0 + 0.35 * speed
        preview = distance + way * (speed * late + np.linspace(-0.5, 1.5, 5))
        bend = way * float(np.mean(track.curvature_at(preview)))
        bend /= 1 + bend * line
        back = np.clip(off, -reach / 2, reach / 2) / reach**2 + 1.6 * np.sin(course) / reach
        return -float(np.degrees(np.arctan(WHEELBASE_M * (bend + back)))) / MAX_STEERING_DEG

    def _throttle(self, world: World) -> float:
        """Return the throttle that reaches and holds the speed that the bends ahead allow."""
        way, speed = world.direction, world.car.ahead_mps
        distance = world.place.distance + way * speed * world.frame_s
        limit = float(self.track.interpolate(self._limits[way], distance))
        if limit >= TOP_SPEED_MPH * MPS_PER_MPH:
            return 1.0
        grade = way * float(self.track.grade_at(distance))
        hold = (DRAG_PER_S * speed + GRAVITY_MPS2 * grade) * MASS_KG / DRIVE_N
        wish = hold + THROTTLE_PER_MPS * (limit - speed)
        # At low speed a negative throttle would reverse the car.
        return float(np.clip(wish, 0.0 if speed < SLOWEST_MPS else -1.0, 1))


def speed_limits(track: Track, settings: ExpertSettings, direction: int) -> np.ndarray:
    """Return speed limits in m/s, float64 [N], at the centreline's samples for a direction."""
    fastest = np.sqrt(settings.cornering_mps2 / (np.abs(track.curvature) + 1e-9))
    limits = np.clip(fastest, SLOWEST_MPS, settings.speed_mph * MPS_PER_MPH)
    ordered = limits[::direction]
    step = track.length / len(ordered)
    # Two laps of a loop, because braking for the first bend begins in the lap before.
    for index in range((1 + track.closed) * len(ordered) - 1, 0, -1):
        after, before = ordered[index % len(ordered)], (index - 1) % len(ordered)
        ordered[before] = min(ordered[before], np.sqrt(after**2 + 2 * settings.braking_mps2 * step))
    return limits

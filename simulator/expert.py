"""The expert: follows a line along the road from what the world knows and no camera shows."""

from dataclasses import dataclass

import numpy as np

from simulator.car import DRAG_PER_S, DRIVE_N, GRAVITY_MPS2, REVERSE_BELOW_MPH
from simulator.errors import SimulatorError
from simulator.rig import (
    MASS_KG,
    MAX_STEERING_DEG,
    MPS_PER_MPH,
    TOP_SPEED_MPH,
    WHEELBASE_M,
)
from simulator.track import Track
from simulator.world import World

SLOWEST_MPS = 3.0
THROTTLE_PER_MPS = 0.4  # per m/s that it is too slow


@dataclass(frozen=True)
class ExpertSettings:
    """How the expert drives.

    Args:
        speed_mph: on the straight; 30 holds the throttle down there, as a person does.
        offset_m: right of the centreline, the line that it keeps to.
        noise: 0..1, how far it sways off now and then: at 1 up to 60 % of the half width.
        sway_every_m: the mean way from one sway's end to the next one's begin.
        cornering_mps2: across; it slows down for bends that would take more.
        braking_mps2: along, ahead of such bends.
        steering_per_s: the most that the steering, -1..1, changes in a second.
        reaction_s: how late its steering takes effect, besides the car's delay.
        seed: of the swaying.
    """

    speed_mph: float = TOP_SPEED_MPH
    offset_m: float = 0.0
    noise: float = 0.0
    sway_every_m: float = 60.0
    cornering_mps2: float = 5.0
    braking_mps2: float = 3.0
    steering_per_s: float = 4.0
    reaction_s: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        ranges = {
            "speed_mph": (REVERSE_BELOW_MPH + 3, TOP_SPEED_MPH),
            "offset_m": (-5, 5),
            "noise": (0, 1),
            "sway_every_m": (30, 1e4),
            "cornering_mps2": (0.5, 8),
            "braking_mps2": (0.5, 6),
            "steering_per_s": (1, 50),
            "reaction_s": (0, 1),
        }
        for key, (low, high) in ranges.items():
            if not low <= getattr(self, key) <= high:
                value = getattr(self, key)
                raise SimulatorError(f"expert: {key}={value}: must be in {low:g}..{high:g}")


class Expert:
    """Drives a world: `expert(world) -> (steering, throttle)`, once a frame.

    The steering is the bend's own plus what brings the car back to its line; the speed is what the
    bends ahead allow. With noise it sways off its line at random and comes back. `recording` is
    False while it goes astray: a network should learn the way back only.
    """

    def __init__(self, track: Track, settings: ExpertSettings | None = None) -> None:
        self.track, self.settings = track, settings or ExpertSettings()
        room = track.width / 2 - 1
        if abs(self.settings.offset_m) > room:
            raise SimulatorError(
                f"expert: offset_m={self.settings.offset_m:g}: the road has {room:.1f} m"
            )
        self._limits = {way: speed_limits(track, self.settings, way) for way in (1, -1)}
        self.reset(self.settings.seed)

    def reset(self, seed: int) -> None:
        """Begin a drive: straight wheels, and sways of another seed."""
        self.rng = np.random.default_rng(seed)
        self.steering = 0.0
        self.recording = True
        self._sway: tuple[float, float, float] | None = None  # from, to (metres driven), how far
        self._next_sway: float | None = None

    def __call__(self, world: World) -> tuple[float, float]:
        """Steering -1..1 (right positive) and throttle -1..1 (braking negative) for a frame."""
        wish = np.clip(self._steering(world, self._line(world)), -1, 1)
        change = self.settings.steering_per_s * world.frame_s
        self.steering = float(np.clip(wish, self.steering - change, self.steering + change))
        return self.steering, self._throttle(world)

    def _line(self, world: World) -> float:
        """Where to drive, metres right of the centreline; begins and ends the sways."""
        usual, driven = self.settings.offset_m, world.travelled
        if self.settings.noise == 0:
            return usual
        if self._next_sway is None:
            # Not sooner than the way back from the last one takes.
            self._next_sway = driven + 25 + self.rng.exponential(self.settings.sway_every_m - 25)
        if self._sway is None and driven >= self._next_sway:
            room = 0.6 * self.track.width / 2 * self.settings.noise
            far = room * self.rng.uniform(0.4, 1) * self.rng.choice([-1, 1])
            self._sway = driven, driven + self.rng.uniform(10, 25), far
            self.recording = False
        if self._sway is None:
            return usual
        begin, end, far = self._sway
        # The car is behind its line, and gets some way to reach it.
        if driven >= end + 10 or world.cte / far >= 0.95:
            self._sway = self._next_sway = None
            self.recording = True
            return usual
        part = np.clip((driven - begin) / (end - begin), 0, 1)
        return usual + (far - usual) * part * part * (3 - 2 * part)

    def _steering(self, world: World, line: float) -> float:
        """The line's curvature ahead, and a second-order return to the line."""
        car, way, track = world.car, world.direction, self.track
        speed = max(car.ahead_mps, 1.0)
        # A command takes effect after the car's delay, and holds for a frame.
        late = car.delay_steps * 0.02 + world.frame_s / 2 + self.settings.reaction_s
        # Where the car goes, not where it points: in a bend its tail hangs out.
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
        wheel = np.arctan(WHEELBASE_M * (bend + back))
        return -float(np.degrees(wheel)) / MAX_STEERING_DEG

    def _throttle(self, world: World) -> float:
        """Holds what the bends ahead allow: the pull that it takes, and more to gain speed."""
        way, speed = world.direction, world.car.ahead_mps
        distance = world.place.distance + way * speed * world.frame_s
        limits = self._limits[way]
        limit = float(np.interp(distance, self.track.distance, limits, period=self.track.length))
        if limit >= TOP_SPEED_MPH * MPS_PER_MPH:
            return 1.0
        grade = way * float(self.track.grade_at(distance))
        hold = (DRAG_PER_S * speed + GRAVITY_MPS2 * grade) * MASS_KG / DRIVE_N
        wish = hold + THROTTLE_PER_MPS * (limit - speed)
        # Slow cars reverse where they should brake.
        lowest = 0.0 if speed < SLOWEST_MPS else -1.0
        return float(np.clip(wish, lowest, 1))


def speed_limits(track: Track, settings: ExpertSettings, direction: int) -> np.ndarray:
    """Metres per second, float64 [N], along the centreline's samples for a way round."""
    tightest = np.abs(track.curvature) + 1e-9
    fastest = np.sqrt(settings.cornering_mps2 / tightest)
    limits = np.clip(fastest, SLOWEST_MPS, settings.speed_mph * MPS_PER_MPH)
    ordered = limits[::direction]
    step = track.length / len(ordered)
    # Twice round, since the last bend's braking begins in the lap before.
    for index in range(2 * len(ordered) - 1, 0, -1):
        after, before = ordered[index % len(ordered)], (index - 1) % len(ordered)
        ordered[before] = min(ordered[before], np.sqrt(after**2 + 2 * settings.braking_mps2 * step))
    return limits

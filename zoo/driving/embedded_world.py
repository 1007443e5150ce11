"""The simulator of this project as a world."""

from typing import Any

import numpy as np

from zoo.base.rig import MPS_PER_MPH, UDACITY
from zoo.driving.drive_record import EMBEDDED
from zoo.driving.scenario import Scenario
from zoo.driving.world import State, World
from zoo.simulator import simulated_world as simulator_world
from zoo.simulator.expert import Expert, ExpertSettings
from zoo.simulator.simulated_world import Start
from zoo.simulator.track_content import make_track
from zoo.simulator.udacity_car import TOP_SPEED_MPH
from zoo.simulator.weather import read_weather

SLOWEST = 0.2  # a drive ends when its mean speed must be lower than this share of the set one
ROAD = "mildest"  # name of a road whose content a scenario has, as of the file that replays it


class EmbeddedWorld(World):
    """A world of the simulator.

    After an intervention the car is put back on the centreline, pointing ahead.

    Args:
        simulated: simulator's world.
    """

    rig = UDACITY

    def __init__(self, simulated: simulator_world.World) -> None:
        self.simulated, self.frame_rate = simulated, 1 / simulated.frame_s
        if simulated.renderer is not None and simulated.renderer.name != "software":
            self.tied = f"{simulated.renderer.name} draws the frames"
        self._expert: Expert | None = None
        self._laps = self._longest_s = 0.0

    def reset(self, scenario: Scenario) -> State:
        """Begin a drive at the scenario's start, in its weather."""
        world = self.simulated
        world.reset(scenario.seed, start_of(world, scenario), read_weather(scenario.weather))
        self._expert, self._laps = None, scenario.laps
        self._longest_s = world.drive_m(scenario.laps) / (SLOWEST * scenario.speed * MPS_PER_MPH)
        return self._state()

    def frame(self, camera: str = "center") -> np.ndarray | None:
        """Return a camera's frame; None without a renderer."""
        return None if self.simulated.renderer is None else self.simulated.frame(camera)

    def step(self, steering: float, throttle: float) -> State:
        """Advance by one frame."""
        self.simulated.step(steering, throttle)
        return self._state()

    def put_back(self, speed_mph: float) -> State:
        """Put the car on the centreline where it is, pointing ahead."""
        self.simulated.put_back(Start(self.simulated.place.distance, speed_mph=speed_mph))
        return self._state()

    def close(self) -> None:
        """Close the renderer."""
        self.simulated.close()

    def facts(self, scenario: Scenario) -> dict[str, Any]:
        """Return the track's name, length and lane, and the seed."""
        track = self.simulated.track
        return {
            "source": EMBEDDED,
            "track": track.name,
            "seed": scenario.seed,
            "lane_m": track.width / 2,
            "length_m": track.length,
        }

    def expert_steering(self) -> float:
        """Return the steering of the simulator's expert at the car's place."""
        self._expert = self._expert or instant_expert(self.simulated)
        return self._expert(self.simulated)[0]

    def _state(self) -> State:
        world, car = self.simulated, self.simulated.car
        return State(
            time_s=world.time,
            speed_mph=car.speed_mph,
            steering=car.steering,
            cross_track_m=world.cte,
            width_m=world.place.width,
            distance_m=world.place.distance,
            driven_m=world.travelled,
            lap=world.lap,
            contact=world.at_wall,
            xy=(car.x, car.y),
            share=min(world.travelled / world.drive_m(self._laps), 1.0),
            done=world.is_complete(self._laps) or world.time >= self._longest_s,
        )


def open_embedded(scenario: Scenario, renderer: str = "auto") -> EmbeddedWorld:
    """Open the simulator's world of a scenario.

    Raises:
        InputError: there is no such track or renderer, or a value is not allowed.
    """
    keys = scenario.place
    if scenario.road is not None:
        keys["track"] = make_track(ROAD, scenario.road)
    return EmbeddedWorld(simulator_world.open_world(renderer=renderer, loop=scenario.loop, **keys))


def instant_expert(world: simulator_world.World, speed_mph: float = TOP_SPEED_MPH) -> Expert:
    """Return an expert for labels, which may change faster than a steering wheel turns."""
    return Expert(world.track, ExpertSettings(speed_mph, steering_per_s=50))


def start_of(world: simulator_world.World, scenario: Scenario) -> Start:
    """Return the start of a scenario; seed 0 is the begin of the road.

    On an open road every seed starts there, beside the centreline, so that a lap is the whole road.
    """
    distance, cte, heading_deg = scenario.start, 0.0, 0.0
    if scenario.seed > 0:
        rng = np.random.default_rng((scenario.seed, 1))
        drawn = rng.uniform(0, world.track.length)
        if world.track.closed and distance is None:
            distance = drawn
        cte, heading_deg = rng.uniform(-0.5, 0.5), rng.uniform(-3, 3)
    return Start(
        distance, cte + scenario.offset, heading_deg + scenario.heading, scenario.start_mph
    )

"""The contract of a world: a place in which a policy drives, in steps of its own time."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np

from zoo.base.rig import Rig
from zoo.driving.scenario import Scenario


@dataclass(frozen=True)
class State:
    """A car at one time; a world leaves out what it does not know.

    Attributes:
        time_s: seconds since the reset.
        speed_mph: speed of the car; NaN if it is unknown.
        steering: steering of the wheels, -1..1, which follows a command late.
        throttle: throttle of the car, -1..1, in a world that drives at its own speed; the policy's
            is then ignored.
        cross_track_m: metres right of the centreline.
        width_m: width of the road at the car.
        distance_m: metres along the lap.
        driven_m: progress since the reset in metres.
        lap: number of whole laps since the reset.
        contact: whether an obstacle holds the car, or it points far away from the road; this is an
            intervention.
        xy: position in metres.
        share: finished share of the drive, 0..1.
        moved: whether the world itself put the car elsewhere, so that a policy must forget.
        episode_return: sum of the rewards so far, per episode of a Gymnasium environment.
        done: whether the drive has ended.
    """

    time_s: float
    speed_mph: float
    steering: float | None = None
    throttle: float | None = None
    cross_track_m: float | None = None
    width_m: float | None = None
    distance_m: float | None = None
    driven_m: float | None = None
    lap: int | None = None
    contact: bool | None = None
    xy: tuple[float, float] | None = None
    share: float = 0.0
    moved: bool = False
    episode_return: float | None = None
    done: bool = False


class World(ABC):
    """A place in which a policy drives.

    The decorator `zoo.driving.open_world.world` registers a class, which is constructed with a
    scenario and a renderer: auto, software or none.

    Attributes:
        rig: car that is driven; None if it is unknown.
        frame_rate: frames per second of the world's time, at which a film plays.
        ignores: keys of a scenario that change nothing here, and are refused.
        tied: why the same commands give other frames on another processor; empty if they do not.
    """

    rig: Rig | None = None
    ignores: tuple[str, ...] = ()
    tied: str = ""
    frame_rate: float = Scenario.frame_rate

    @abstractmethod
    def reset(self, scenario: Scenario) -> State:
        """Begin a drive.

        Raises:
            InputError: the scenario cannot be driven in this world.
        """

    @abstractmethod
    def frame(self, camera: str = "center") -> np.ndarray | None:
        """Return a camera's frame, uint8 [H, W, 3] RGB; None without a renderer."""

    @abstractmethod
    def step(self, steering: float, throttle: float) -> State:
        """Advance by one frame; right and ahead are positive, -1..1."""

    @abstractmethod
    def put_back(self, speed_mph: float) -> State:
        """Put the car back on the road after an intervention, at a speed if the world can."""

    def close(self) -> None:  # noqa: B027 - many worlds hold nothing
        """Release what the world holds; it is not used again."""

    def facts(self, scenario: Scenario) -> dict[str, Any]:
        """Return known attributes of `zoo.driving.drive_record.Drive`, such as `length_m`."""
        return {"track": scenario.world, "seed": scenario.seed}

    def expert_steering(self) -> float:
        """Return the steering of an expert at the car's place, -1..1; NaN without an expert."""
        return float("nan")

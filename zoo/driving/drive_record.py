"""`Drive`: the record of a drive on a socket, in the embedded world or in a replay."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from operator import attrgetter
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

OfRows = TypeVar("OfRows", bound="Drive")

POLICY, PERSON, FALLBACK = "policy", "person", "fallback"
EMBEDDED, SOCKET, REPLAY = "embedded", "socket", "replay"  # sources of drives
BAND = 1.96  # standard deviations on each side that hold 95 % of a normal distribution
# dtypes of the columns that are not float64
TYPES = {"client": np.int64, "driver": np.str_, "frame": np.str_, "intervention": np.bool_}


@dataclass(frozen=True)
class DriveRow:
    """One time step of a drive.

    Attributes:
        time_s: time since the drive began, in seconds.
        client: number of the simulator, in the order of connection from 1.
        driver: `policy`; `person`, who took over; or `fallback`, after an error.
        frame: path of the frame within the drive's folder; empty if it was not recorded.
        steering: steering that was sent, -1..1, negative is left.
        throttle: throttle that was sent, -1..1, negative brakes.
        speed_mph: speed of the car; NaN if unknown.
        cross_track_m: signed distance from the centreline in metres, positive is right; NaN if
            unknown.
        intervention: whether an intervention began in this step.
        latency_ms: time from the frame's arrival to the reply in milliseconds; NaN if unknown.
        spread: standard deviation of the steering by which the policy doubts it; NaN if unknown.
        expert_steering: steering of the embedded world's expert at the same place, or of the
            recorded driver in a replay, -1..1; NaN if unknown.
    """

    time_s: float
    client: int = 1
    driver: str = POLICY
    frame: str = ""
    steering: float = 0.0
    throttle: float = 0.0
    speed_mph: float = math.nan
    cross_track_m: float = math.nan
    intervention: bool = False
    latency_ms: float = math.nan
    spread: float = math.nan
    expert_steering: float = math.nan


@dataclass(frozen=True, eq=False)
class Drive:
    """A drive: its N time steps as columns, and facts about it.

    Attributes:
        time_s, steering, throttle, speed_mph, cross_track_m, latency_ms, spread, expert_steering:
            float64 [N], see `DriveRow`.
        client: int64 [N].
        driver, frame: str [N].
        intervention: bool [N].
        folder: folder that the drive was read from; `frame` is relative to it. None before the
            drive is written.
        summary: content of `drive.json`; empty if the drive's process was killed.
        source: EMBEDDED, SOCKET or REPLAY; empty if unknown.
        track: name of the track; empty if unknown.
        seed: seed of start and weather.
        lane_m: distance from the centreline in metres above which the car has left the lane.
        length_m: length of a lap in metres.
        driven_m: progress along the track in metres.
        lap_s: simulated seconds of each whole lap.
        nan_frames: number of frames for which the policy returned NaN; the car was steered
            straight on instead.
        infractions: number of interventions by what they correct, see `INFRACTIONS`.
        episode_return: sum of the rewards per episode of a Gymnasium environment.
        expert_steering_per_s: steering change per second of the expert, or of a replay's recorded
            driver.
        tied: why the drive differs on another processor; empty if it does not, or is of a socket.
        xy: positions of the car in metres, float64 [N, 2].
        distance_m: distance along the lap from the track's first point in metres, float64 [N].

    Unknown values are NaN for `lane_m`, `length_m`, `driven_m`, `episode_return` and
    `expert_steering_per_s`, and None for `xy` and `distance_m`.
    """

    time_s: np.ndarray
    client: np.ndarray
    driver: np.ndarray
    frame: np.ndarray
    steering: np.ndarray
    throttle: np.ndarray
    speed_mph: np.ndarray
    cross_track_m: np.ndarray
    intervention: np.ndarray
    latency_ms: np.ndarray
    spread: np.ndarray
    expert_steering: np.ndarray
    folder: Path | None = None
    summary: dict = field(default_factory=dict)
    source: str = ""
    track: str = ""
    seed: int = 0
    lane_m: float = math.nan
    length_m: float = math.nan
    driven_m: float = math.nan
    lap_s: Sequence[float] = ()
    nan_frames: int = 0
    infractions: Mapping[str, int] = field(default_factory=dict)
    episode_return: float = math.nan
    expert_steering_per_s: float = math.nan
    tied: str = ""
    xy: np.ndarray | None = None
    distance_m: np.ndarray | None = None

    @classmethod
    def of(cls: type[OfRows], rows: Sequence[DriveRow], **facts: Any) -> OfRows:
        """Return a drive of rows; further attributes of `Drive` as keywords.

        >>> drive = Drive.of([DriveRow(0.0, speed_mph=9.0), DriveRow(0.1)], track="lake")
        >>> len(drive), drive.track, drive.speed_mph.tolist()
        (2, 'lake', [9.0, nan])
        """
        names = DriveRow.__dataclass_fields__
        # Not dataclasses.astuple, which copies each value: a tenth of a drive's time.
        columns = zip(*map(attrgetter(*names), rows), strict=True) if rows else [()] * len(names)
        arrays: dict[str, Any] = {
            name: np.array(column, TYPES.get(name, np.float64))
            for name, column in zip(names, columns, strict=True)
        }
        return cls(**arrays, **facts)

    def __len__(self) -> int:
        return len(self.time_s)

    @cached_property
    def rows(self) -> list[DriveRow]:
        """Return the drive as a list of rows."""
        columns = (getattr(self, name).tolist() for name in DriveRow.__dataclass_fields__)
        return [DriveRow(*values) for values in zip(*columns, strict=True)]


@dataclass(frozen=True, eq=False)
class WrittenDrive(Drive):
    """A drive that was read from its folder."""

    folder: Path

"""`Drive`: the one record of a drive, of a socket, the embedded world or a replay."""

import math
from collections.abc import Sequence
from dataclasses import astuple, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

POLICY, PERSON, FALLBACK = "policy", "person", "fallback"
EMBEDDED, SOCKET, REPLAY = "embedded", "socket", "replay"  # where a drive took place
# Of the columns that are not float64.
TYPES = {"client": np.int64, "driver": np.str_, "frame": np.str_, "intervention": np.bool_}


@dataclass(frozen=True)
class DriveRow:
    """A time step of a drive.

    Attributes:
        time_s: since the drive began.
        client: which simulator it was, 1 is the first that connected.
        driver: `policy`; `person` who overrode it; `fallback`, where something went wrong.
        frame: the picture's path within the drive's folder; empty where it was not recorded.
        steering: that was sent, -1..1.
        throttle: that was sent, -1..1, negative brakes.
        speed_mph: of the car; NaN where it is not known.
        cross_track_m: from the centre line; NaN where it is not known.
        intervention: a person, or the scoring, began to intervene in this step.
        latency_ms: from the frame's arrival to the reply's departure; NaN where there was none.
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


@dataclass(frozen=True, eq=False)
class Drive:
    """A drive as columns, in the order in which it took place, and what else is known of it.

    Attributes:
        time_s, steering, throttle, speed_mph, cross_track_m, latency_ms: float64 [N].
        client: int64 [N].
        driver, frame: str [N].
        intervention: bool [N].
        folder: place that it was read from, to which `frame` is relative; None before it is kept.
        summary: content of `drive.json`; empty where the drive was cut off.
        source: EMBEDDED, SOCKET or REPLAY; empty where it is not known.
        track: name of the track; empty where it is not known.
        seed: seed of start and weather.
        lane_m: distance from the centreline that counts as leaving the lane.
        length_m: length of a lap.
        driven_m: progress along the track.
        lap_s: seconds of simulated time of each whole lap.
        nan_frames: number of frames in which the policy steered NaN; the car went straight on.
        expert_steering_per_s: steering change of the expert, or of the recorded driver.
        xy: position of the car, metres, float64 [N, 2].
        distance_m: place along the lap, from the track's first point, float64 [N].

    `lane_m`, `length_m`, `driven_m` and `expert_steering_per_s` are NaN, `xy` and `distance_m`
    None, where they are not known.
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
    expert_steering_per_s: float = math.nan
    xy: np.ndarray | None = None
    distance_m: np.ndarray | None = None

    @classmethod
    def of(cls, rows: Sequence[DriveRow], **known: Any) -> "Drive":
        """Return a drive of rows, with what else is known of it.

        >>> drive = Drive.of([DriveRow(0.0, speed_mph=9.0), DriveRow(0.1)], track="lake")
        >>> len(drive), drive.track, drive.speed_mph.tolist()
        (2, 'lake', [9.0, nan])
        """
        names = DriveRow.__dataclass_fields__
        columns = zip(*map(astuple, rows), strict=True) if rows else [()] * len(names)
        arrays: dict[str, Any] = {
            name: np.array(column, TYPES.get(name, np.float64))
            for name, column in zip(names, columns, strict=True)
        }
        return cls(**arrays, **known)

    def __len__(self) -> int:
        return len(self.time_s)

    @cached_property
    def rows(self) -> list[DriveRow]:
        """The drive row by row."""
        columns = (getattr(self, name).tolist() for name in DriveRow.__dataclass_fields__)
        return [DriveRow(*values) for values in zip(*columns, strict=True)]

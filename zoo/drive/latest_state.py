"""The present state of a drive, which the live page shows."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class LatestState:
    """State of the drive for the live page; None for unknown values.

    Attributes:
        frame: latest frame, uint8 [160, 320, 3] RGB, which must not be changed; None before the
            first.
        spread: standard deviation of the steering.
        lost: `off_road` or `standstill` while the car is in that state, else None.
        put_back: whether the simulator puts the car back after an intervention.
    """

    frame: np.ndarray | None
    steering: float
    spread: float | None
    throttle: float
    speed_mph: float
    cross_track_m: float | None
    latency_ms: float | None
    clients: int
    telemetry: int
    interventions: int
    off_road: int
    standstills: int
    takeovers: int
    lost: str | None
    put_back: bool
    fallbacks: int
    driven_s: float
    autonomy: float | None
    overridden: bool
    paused: bool
    set_mph: float | None
    recording: bool
    recorded: int
    folder: str
    checkpoint: str
    troubles: dict[str, int]

"""A simulator that is connected to the driver."""

import math
from collections.abc import Callable

import numpy as np

from zoo.drive.telemetry_message import Telemetry, parse_number
from zoo.drives.interventions import DEFAULT_MARGIN_M, InterventionRule
from zoo.drives.speed_controller import SpeedController
from zoo.drives.steering_filter import SteeringFilter

# A frame uint8 [160, 320, 3] RGB and mph -> steering -1..1 and throttle -1..1 or None.
DrivingPolicy = Callable[[np.ndarray, float], tuple[float, float | None]]


class Session:
    """What is remembered of it from telemetry to telemetry."""

    def __init__(
        self,
        number: int,
        controller: SpeedController,
        steer: SteeringFilter,
        margin_m: float | None = None,
    ) -> None:
        self.number, self.controller, self.steer = number, controller, steer
        self.rule = InterventionRule(margin_m or DEFAULT_MARGIN_M)
        self.sends_cross_track = self.can_put_back = False
        self._margin_m = margin_m
        self.decimal: str | None = None
        self.steering = self.speed_mph = 0.0
        self.last_s = self.heard_s = -math.inf
        self.overridden = False
        # What a policy was asked last, and what it said.
        self._asked: tuple[DrivingPolicy, bytes, float] | None = None
        self._predicted: tuple[float, float | None] = 0.0, None
        self._clock_s: float | None = None  # of the simulator, which the original does not tell
        self._ahead_s = 0.0

    def now(self, data: object, wall_s: float) -> float:
        """The time of a telemetry in seconds: by the simulator's own clock where it tells it, since
        one that waits for each reply may drive faster than the wall clock; else `wall_s`."""
        told = parse_number(data.get("time")) if isinstance(data, dict) else None
        if told is not None:
            if self._clock_s is None or told < self._clock_s:  # it has begun anew
                self._ahead_s = max(wall_s, self.last_s) - told
            self._clock_s = told
        return wall_s if self._clock_s is None else self._clock_s + self._ahead_s

    def judge(self, telemetry: Telemetry, now_s: float, held: bool) -> str | None:
        """Return the kind of intervention that begins with a telemetry, None for none.

        Without a cross-track error nothing is counted, but `rule.state` notes a standstill.

        Args:
            telemetry: where the car is.
            now_s: its time.
            held: the driver itself keeps the car from moving.
        """
        self.sends_cross_track |= math.isfinite(telemetry.cross_track_m)
        self.can_put_back = telemetry.can_put_back
        if self._margin_m is None and (telemetry.lane_m or 0) > 0:
            self.rule.margin_m = telemetry.lane_m
        mph = math.inf if held else self.speed_mph
        kind = self.rule.judge(now_s, mph, telemetry.cross_track_m, telemetry.at_wall)
        return kind if self.sends_cross_track else None

    def predict(self, policy: DrivingPolicy, telemetry: Telemetry) -> tuple[float, float | None]:
        """What the policy says. It looks once at a picture that is sent again, as the original's
        two loops do with most: looking is what takes longest."""
        asked = policy, telemetry.picture, self.speed_mph
        if asked != self._asked:
            self._predicted = policy(telemetry.frame, self.speed_mph)
            self._asked = asked
        return self._predicted

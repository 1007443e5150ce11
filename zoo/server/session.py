"""The state of one simulator that is connected to the driver."""

import math

from zoo.base.limits import parse_number
from zoo.checkpoints.policy_base import Command, Policy, PolicyFunction, as_policy
from zoo.driving.interventions import DEFAULT_MARGIN_M, InterventionRule
from zoo.driving.latency_meter import LatencyMeter, latency_meter
from zoo.driving.speed_controller import SpeedController, SteeringFilter
from zoo.server.telemetry_message import Telemetry


class Session:
    """State of a simulator between two telemetry messages.

    Args:
        number: number of the simulator, in the order of connection from 1.
        controller: speed controller of this simulator.
        steer: steering filter of this simulator.
        margin_m: distance from the centreline in metres above which the car has left the lane; None
            for the edge line.
    """

    def __init__(
        self,
        number: int,
        controller: SpeedController,
        steer: SteeringFilter,
        margin_m: float | None = None,
    ) -> None:
        self.number, self.controller, self.steer = number, controller, steer
        self.rule = InterventionRule(margin_m or DEFAULT_MARGIN_M)
        self.sends_cross_track: bool | None = None  # unknown before the first readable telemetry
        self.can_put_back = False
        self._margin_m = margin_m
        self.decimal: str | None = None
        self.speed_mph = math.nan
        self.steering = self.seen_mph = 0.0  # a NaN stays in a network's memory
        self.last_s = self.heard_s = -math.inf
        self.overridden = False
        self.begins = False  # whether the next frame is the first of another place, or car
        # Policy of all simulators, and the one with this simulator's state.
        self._shared: PolicyFunction | None = None
        self._policy: Policy | None = None
        # Last input of the policy, and its output.
        self._asked: tuple[PolicyFunction, bytes, float] | None = None
        self._command = Command(0.0)
        self._meter: LatencyMeter | None = None  # None for a policy that does not predict ahead
        self._clock_s: float | None = None  # simulator's time; None for the original simulator
        self._ahead_s = 0.0

    def now(self, data: object, wall_s: float) -> float:
        """Return the time of a telemetry in seconds.

        It is the simulator's time if the telemetry has one, since a simulator that waits for each
        reply may drive faster than the wall clock. Otherwise it is `wall_s`.
        """
        sent_s = parse_number(data.get("time")) if isinstance(data, dict) else None
        if sent_s is not None:
            if self._clock_s is None or sent_s < self._clock_s:  # the simulator has restarted
                self._ahead_s = max(wall_s, self.last_s) - sent_s
                self.forget()
            self._clock_s = sent_s
        return wall_s if self._clock_s is None else self._clock_s + self._ahead_s

    def judge(self, telemetry: Telemetry, now_s: float, held: bool) -> str | None:
        """Return the kind of intervention that begins with a telemetry, None for none.

        Nothing is counted for a simulator without cross-track error, but `rule.state` is updated.

        Args:
            telemetry: telemetry of the car.
            now_s: time of the telemetry in seconds.
            held: whether the driver itself keeps the car from moving.
        """
        self.sends_cross_track = self.sends_cross_track or math.isfinite(telemetry.cross_track_m)
        self.can_put_back = telemetry.can_put_back
        if self._margin_m is None and telemetry.lane_m and telemetry.lane_m > 0:
            self.rule.margin_m = telemetry.lane_m
        mph = math.inf if held else telemetry.speed_mph
        kind = self.rule.judge(now_s, mph, telemetry.cross_track_m, telemetry.at_wall)
        return kind if self.sends_cross_track else None

    def restart(self) -> None:
        """Forget everything of the drive before: when a person drove, or the car is put back."""
        self.controller.reset()
        self.steer.reset()
        self.forget()

    def forget(self) -> None:
        """Forget the frames and commands before: after a pause, when a person drove, or put back.

        The policy is called for the next frame, even if it is the last one again.
        """
        self._asked = None
        self.begins = True
        if self._policy is not None:
            self._policy.reset()
        if self._meter is not None:
            self._meter.restart()

    def send(self, steering: float) -> None:
        """Store the steering that is sent."""
        self.steering = steering
        if self._meter is not None:
            self._meter.send(steering)

    def predict(self, policy: PolicyFunction, telemetry: Telemetry, now_s: float) -> Command:
        """Return the policy's command; a policy with memory has a state for each simulator.

        The policy is called once for an image that is sent twice, as the original's two loops do
        with most images. The call takes most of the latency.
        """
        if self._policy is None or policy is not self._shared:
            self._shared, self._policy = policy, as_policy(policy).session()
            self._policy.reset()  # a policy without sessions may remember an earlier one
            self._meter = latency_meter(self._policy)
        if self._meter is not None and telemetry.steering is not None:
            self._meter.report(telemetry.steering, now_s)
        asked = policy, telemetry.image, self.seen_mph
        if asked != self._asked:
            self._command = self._policy(telemetry.frame, self.seen_mph)
            self._asked = asked
        return self._command

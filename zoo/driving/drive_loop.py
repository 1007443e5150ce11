"""One drive of a policy in a world; and a policy that an environment's own loop asks."""

import math
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from zoo.base.rig import MPS_PER_MPH
from zoo.checkpoints.policy_base import Command, Policy, PolicyFunction, as_policy
from zoo.driving.drive_record import REPLAY, Drive, DriveRow
from zoo.driving.interventions import DEFAULT_MARGIN_M, InterventionRule
from zoo.driving.latency_meter import latency_meter
from zoo.driving.scenario import Scenario
from zoo.driving.speed_controller import PI, Network, SpeedController
from zoo.driving.world import World

Show = Callable[[np.ndarray | None, DriveRow], bool | None]


def speed_controller(scenario: Scenario) -> SpeedController:
    """Return the controller of a scored drive: the Udacity course's, or the network's throttle."""
    return Network() if scenario.throttle == "network" else PI(scenario.speed, kp=0.1, ki=0.002)


def drivable(command: Command) -> Command:
    """Return a command with its steering in -1..1; NaN steers straight on."""
    steering = 0.0 if math.isnan(command.steering) else float(command.steering)
    return replace(command, steering=min(max(steering, -1.0), 1.0))


def drive(
    policy: Policy | PolicyFunction,
    world: World,
    scenario: Scenario,
    show: Show | None = None,
    report: Callable[[float], None] | None = None,
    first_only: bool = False,
    speed: SpeedController | None = None,
) -> Drive:
    """Let a policy drive a scenario in an open world.

    After an intervention (see `InterventionRule`) the car is put back. A policy that returns NaN is
    steered straight on. The rows of a policy that predicts its spread also have the expert's
    steering, in a world that has an expert; those of a replay have the recorded driver's.

    Args:
        policy: policy; it is reset at the start and whenever the car is put back. If it predicts
            ahead, its `latency_s` is measured.
        world: world to drive in.
        scenario: what to drive.
        show: function called with every frame, uint8 [H, W, 3] RGB, and its row; the drive
            ends when it returns True.
        report: function called at every frame with the share of the drive that is done, 0..1.
        first_only: end the drive at its first intervention.
        speed: speed controller; None for the scenario's.
    """
    policy, speed = as_policy(policy), speed or speed_controller(scenario)
    state = world.reset(scenario)
    policy.in_car(world.rig)
    speed.reset()
    policy.reset()
    meter = latency_meter(policy)
    tied = policy.tied or world.tied
    facts: dict[str, Any] = {"lane_m": DEFAULT_MARGIN_M, "tied": tied} | world.facts(scenario)
    if scenario.margin is not None:
        facts["lane_m"] = scenario.margin
    rows: list[DriveRow] = []
    places: list[tuple[float, float] | None] = []
    distance_m: list[float | None] = []
    lap_s: list[float] = []
    nan_frames, seen_mph = 0, math.nan
    infractions: Counter[str] = Counter()
    rule, lap_began_s = InterventionRule(facts["lane_m"]), 0.0
    while not state.done:
        frame = world.frame()
        if meter and state.steering is not None:
            meter.report(state.steering, state.time_s)
        began, mph = time.perf_counter(), state.speed_mph
        seen_mph = seen_mph if math.isnan(mph) else mph  # a NaN stays in a network's memory
        command = policy(frame, seen_mph)
        latency_ms = 1000 * (time.perf_counter() - began)
        nan_frames += math.isnan(command.steering)
        command = drivable(command)
        if meter:
            meter.send(command.steering)
        asks_expert = command.spread is not None or facts.get("source") == REPLAY
        throttle = state.throttle
        if throttle is None:
            throttle = speed.pedal(command, mph, state.time_s)
        if scenario.margin is None and state.width_m is not None:
            rule.margin_m = state.width_m / 2
        cross_track_m = math.nan if state.cross_track_m is None else state.cross_track_m
        # A car that drives at the world's own speed does not stall.
        judged_mph = mph if state.throttle is None else math.inf
        kind = rule.judge(state.time_s, judged_mph, cross_track_m, bool(state.contact))
        if kind is not None:
            infractions[rule.infraction(kind, cross_track_m)] += 1
        row = DriveRow(
            time_s=state.time_s,
            steering=command.steering,
            throttle=throttle,
            speed_mph=mph,
            cross_track_m=cross_track_m,
            intervention=kind is not None,
            latency_ms=latency_ms,
            spread=math.nan if command.spread is None else command.spread,
            expert_steering=world.expert_steering() if asks_expert else math.nan,
        )
        rows.append(row)
        places.append(state.xy)
        distance_m.append(state.distance_m)
        ended = show is not None and show(frame, row)
        if report:
            report(state.share)
        if ended or (row.intervention and first_only):
            break
        if row.intervention:
            state = world.put_back(mph if speed.set_mph is None else speed.set_mph)
            speed.reset()
        else:
            state = world.step(command.steering, throttle)
        if row.intervention or state.moved:
            policy.reset()
            rule.restart()
            if meter:
                meter.restart()
        if (state.lap or 0) > len(lap_s):
            lap_s.append(state.time_s - lap_began_s)
            lap_began_s = state.time_s
    return Drive.of(
        rows,
        **facts,
        driven_m=_driven_m(rows) if state.driven_m is None else state.driven_m,
        lap_s=lap_s,
        nan_frames=nan_frames,
        infractions=dict(infractions),
        episode_return=math.nan if state.episode_return is None else state.episode_return,
        xy=None if None in places else np.array(places),
        distance_m=None if None in distance_m else np.array(distance_m),
    )


class EnvironmentPolicy:
    """Policy that drives a Gymnasium environment: `env.step(policy(observation))`.

    Its throttle is that of a speed controller, as in scored drives.

    Args:
        policy: policy that steers.
        speed: speed controller.
        frame_rate: steps of the environment per second of simulated time.
    """

    def __init__(
        self, policy: Policy | PolicyFunction, speed: SpeedController, frame_rate: float
    ) -> None:
        self.policy, self.speed, self.frame_rate = as_policy(policy).session(), speed, frame_rate
        self.reset()

    def reset(self) -> None:
        """Forget the steps before; call it after `env.reset`."""
        self._steps = 0
        self.policy.reset()
        self.speed.reset()

    def __call__(self, observation: Mapping[str, Any]) -> np.ndarray:
        """Return the action for an observation: steering and throttle, float32 [2] in -1..1.

        Args:
            observation: `image`, uint8 [H, W, 3] RGB, and `speed`, float [1] in mph.

        Raises:
            InputError: the image has another shape or type.
        """
        mph = float(np.asarray(observation["speed"]).item())
        command = drivable(self.policy(observation["image"], mph))
        throttle = self.speed.pedal(command, mph, self._steps / self.frame_rate)
        self._steps += 1
        return np.array([command.steering, throttle], np.float32)


def _driven_m(rows: list[DriveRow]) -> float:
    """Return the metres driven at the rows' speeds, for a world that does not know them."""
    seconds = np.diff([row.time_s for row in rows])
    return float(np.array([row.speed_mph for row in rows])[:-1] @ seconds) * MPS_PER_MPH

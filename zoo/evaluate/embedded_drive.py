"""One drive of a policy in the embedded world."""

import math
import time
from collections.abc import Callable

import numpy as np

from simulator.expert import Expert, ExpertSettings
from simulator.rig import TOP_SPEED_MPH
from simulator.weather import CLEAR, Weather
from simulator.world import Start, World
from zoo.checkpoints.command import PolicyFunction, call_policy, reset_policy
from zoo.drives.drive_record import EMBEDDED, Drive, DriveRow
from zoo.drives.interventions import InterventionRule
from zoo.drives.latency_meter import latency_meter
from zoo.drives.speed_controller import SpeedController, keep_limit, limit_pedal

SLOWEST_MPH = 3.0  # a drive ends when its mean speed must be lower than this


def drive_closed_loop(
    policy: PolicyFunction,
    world: World,
    speed: SpeedController,
    seed: int,
    laps: float,
    weather: Weather | str = CLEAR,
    margin_m: float | None = None,
    start: Start | None = None,
    show: Callable[[np.ndarray, DriveRow], None] | None = None,
    report: Callable[[float], None] | None = None,
    first_only: bool = False,
) -> Drive:
    """Let a policy drive laps in the embedded world.

    After an intervention (see `InterventionRule`) the car is put back on the centreline, pointing
    ahead, at the speed to hold. A policy that returns NaN is steered straight on. The rows of a
    policy that predicts its spread also have the expert's steering.

    Args:
        policy: policy; it is reset at the start and whenever the car is put back. If it predicts
            ahead, its `latency_s` is measured.
        world: world to drive in.
        speed: speed controller.
        seed: random seed of start and weather; 0 starts at the track's first point.
        laps: number of laps to drive; an open road ends every drive at its end.
        weather: weather, or `random` for weather drawn from the seed.
        margin_m: distance from the centreline in metres above which the car has left the lane;
            None for the edge line.
        start: start of the drive; None for the start drawn from the seed.
        show: function called with every frame, uint8 [160, 320, 3] RGB, and its row.
        report: function called at every frame with the share of the laps that is driven, 0..1.
        first_only: end the drive at its first intervention.
    """
    world.reset(seed, start or start_of(world, seed, speed.set_mph or 0.0), weather)
    speed.reset()
    reset_policy(policy)
    meter = latency_meter(policy)
    expert: Expert | None = None
    lane_m = world.track.width / 2 if margin_m is None else margin_m
    rows: list[DriveRow] = []
    xy: list[tuple[float, float]] = []
    distance_m: list[float] = []
    lap_s: list[float] = []
    nan_frames = 0
    longest_s = world.drive_m(laps) / (SLOWEST_MPH * 0.44704)
    rule, lap_began_s = InterventionRule(lane_m), 0.0
    while not world.is_complete(laps) and world.time < longest_s:
        frame = world.frame() if world.pictures is not None else None
        if meter:
            meter.report(world.car.steering, world.time)
        began = time.perf_counter()
        command = call_policy(policy, frame, world.car.speed_mph)
        latency_ms = 1000 * (time.perf_counter() - began)
        steering = command.steering
        if math.isnan(steering):
            nan_frames += 1
            steering = 0.0
        steering = min(max(float(steering), -1.0), 1.0)
        if meter:
            meter.send(steering)
        spread = expert_steering = math.nan
        if command.spread is not None:
            spread = command.spread
            expert = expert or instant_expert(world)
            expert_steering = expert(world)[0]
        mph = world.car.speed_mph
        throttle = speed.throttle(mph, steering, command.throttle, world.time, command.spread)
        throttle = limit_pedal(keep_limit(speed, throttle, mph, command.limit_mph), mph)
        if margin_m is None:
            rule.margin_m = world.place.width / 2
        lost = rule.judge(world.time, mph, world.cte, world.at_wall) is not None
        row = DriveRow(
            time_s=world.time,
            steering=steering,
            throttle=throttle,
            speed_mph=mph,
            cross_track_m=world.cte,
            intervention=lost,
            latency_ms=latency_ms,
            spread=spread,
            expert_steering=expert_steering,
        )
        rows.append(row)
        xy.append((world.car.x, world.car.y))
        distance_m.append(world.place.distance)
        if show:
            show(frame, row)
        if report:
            report(min(world.travelled / world.drive_m(laps), 1.0))
        if lost and first_only:
            break
        if lost:
            reset_policy(policy)
            if meter:
                meter.restart()
            world.put_back(Start(world.place.distance, speed_mph=speed.set_mph or mph))
            speed.reset()
            rule.restart()
            continue
        world.step(steering, throttle)
        if world.lap > len(lap_s):
            lap_s.append(world.time - lap_began_s)
            lap_began_s = world.time
    return Drive.of(
        rows,
        source=EMBEDDED,
        track=world.track.name,
        seed=seed,
        lane_m=lane_m,
        length_m=world.track.length,
        driven_m=world.travelled,
        lap_s=lap_s,
        nan_frames=nan_frames,
        xy=np.array(xy),
        distance_m=np.array(distance_m),
    )


def instant_expert(world: World, speed_mph: float = TOP_SPEED_MPH) -> Expert:
    """Return an expert for labels, which may change faster than a steering wheel turns."""
    return Expert(world.track, ExpertSettings(speed_mph, steering_per_s=50))


def start_of(world: World, seed: int, speed_mph: float) -> Start:
    """Return the start that a seed draws, at a speed; seed 0 is the begin of the road.

    On an open road every seed starts there, beside the centreline, so that a lap is the whole road.
    """
    if seed == 0:
        return Start(speed_mph=speed_mph)
    rng = np.random.default_rng((seed, 1))
    distance = rng.uniform(0, world.track.length)
    return Start(
        distance=distance if world.track.closed else None,
        cte=rng.uniform(-0.5, 0.5),
        heading_deg=rng.uniform(-3, 3),
        speed_mph=speed_mph,
    )

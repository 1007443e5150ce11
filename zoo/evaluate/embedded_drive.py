"""One drive of a policy in the embedded world."""

import math
import time
from collections.abc import Callable

import numpy as np

from simulator.weather import CLEAR, Weather
from simulator.world import Start, World
from zoo.drives.drive_record import EMBEDDED, Drive, DriveRow
from zoo.drives.interventions import InterventionRule
from zoo.drives.speed_controller import SpeedController, limit_pedal

SLOWEST_MPH = 3.0  # a drive that averages less is given up

Policy = Callable[[np.ndarray | None, float], tuple[float, float | None]]


def drive_closed_loop(
    policy: Policy,
    world: World,
    speed: SpeedController,
    seed: int,
    laps: float,
    weather: Weather | str = CLEAR,
    margin_m: float | None = None,
    start: Start | None = None,
    show: Callable[[np.ndarray, DriveRow], None] | None = None,
    report: Callable[[float], None] | None = None,
) -> Drive:
    """Let a policy drive laps from a start that the seed draws.

    An intervention (see `InterventionRule`) puts the car back on the centre, pointing ahead, at the
    speed to hold. Seed 0 starts at the track's first point, in the middle.

    Args:
        policy: frame uint8 [160, 320, 3] RGB (None in a world without a renderer, for a policy
            that needs no eyes) and mph -> steering, and throttle or None.
        world: where to drive.
        speed: how much throttle, from simulated time.
        seed: of start and weather.
        laps: how many to drive.
        weather: or `random`, for one that the seed draws.
        margin_m: from the centreline; None is the edge line.
        start: instead of the seed's.
        show: is given every frame, uint8 RGB, with its row.
        report: is given, at every frame, the share of the laps that is driven, 0..1.
    """
    world.reset(seed, start or start_of(world, seed, speed.set_mph or 0.0), weather)
    speed.reset()
    lane = world.track.width / 2 if margin_m is None else margin_m
    rows: list[DriveRow] = []
    xy: list[tuple[float, float]] = []
    distance_m: list[float] = []
    lap_s: list[float] = []
    nan_frames = 0
    longest_s = laps * world.track.length / (SLOWEST_MPH * 0.44704)
    rule, lap_began_s = InterventionRule(lane), 0.0
    while world.travelled < laps * world.track.length and world.time < longest_s:
        frame = world.frame() if world.pictures is not None else None
        began = time.perf_counter()
        steering, predicted = policy(frame, world.car.speed_mph)
        latency_ms = 1000 * (time.perf_counter() - began)
        if math.isnan(steering):
            nan_frames += 1
            steering = 0.0
        steering = min(max(float(steering), -1.0), 1.0)
        mph = world.car.speed_mph
        throttle = limit_pedal(speed.throttle(mph, steering, predicted, world.time), mph)
        lost = rule.judge(world.time, mph, world.cte, world.at_wall) is not None
        row = DriveRow(
            time_s=world.time,
            steering=steering,
            throttle=throttle,
            speed_mph=mph,
            cross_track_m=world.cte,
            intervention=lost,
            latency_ms=latency_ms,
        )
        rows.append(row)
        xy.append((world.car.x, world.car.y))
        distance_m.append(world.place.distance)
        if show:
            show(frame, row)
        if report:
            report(min(world.travelled / (laps * world.track.length), 1.0))
        if lost:
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
        lane_m=lane,
        length_m=world.track.length,
        driven_m=world.travelled,
        lap_s=lap_s,
        nan_frames=nan_frames,
        xy=np.array(xy),
        distance_m=np.array(distance_m),
    )


def start_of(world: World, seed: int, speed_mph: float) -> Start:
    """Where a seed's drive begins, at a speed."""
    if seed == 0:
        return Start(speed_mph=speed_mph)
    rng = np.random.default_rng((seed, 1))
    return Start(
        distance=rng.uniform(0, world.track.length),
        cte=rng.uniform(-0.5, 0.5),
        heading_deg=rng.uniform(-3, 3),
        speed_mph=speed_mph,
    )

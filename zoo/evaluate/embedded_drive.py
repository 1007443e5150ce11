"""One drive of a policy in the embedded world, from which all figures are taken."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from simulator.weather import CLEAR, Weather
from simulator.world import Start, World
from zoo.drives.drive_log import DriveRow
from zoo.drives.drive_metrics import autonomy
from zoo.drives.interventions import STALLED_BELOW_MPH, InterventionRule
from zoo.drives.speed_controller import SpeedController, limit_pedal

SLOWEST_MPH = 3.0  # a drive that averages less is given up

Policy = Callable[[np.ndarray | None, float], tuple[float, float | None]]


@dataclass
class ScoredDrive:
    """A drive's rows, and what only the embedded world knows.

    Attributes:
        track: its name.
        seed: of start and weather.
        lane_m: how far off the centreline counts as leaving the lane.
        length_m: of a lap.
        rows: one a frame.
        xy: where the car was, metres, one a frame.
        distance_m: along the lap, from the track's first point, one a frame.
        lap_s: seconds of simulated time of each whole lap.
        driven_m, laps: total progress along the track.
        nan_frames: number of frames in which the policy steered NaN; the car went straight on.
    """

    track: str
    seed: int
    lane_m: float
    length_m: float
    rows: list[DriveRow] = field(default_factory=list)
    xy: list[tuple[float, float]] = field(default_factory=list)
    distance_m: list[float] = field(default_factory=list)
    lap_s: list[float] = field(default_factory=list)
    driven_m: float = 0.0
    laps: int = 0
    nan_frames: int = 0


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
) -> ScoredDrive:
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
    drive = ScoredDrive(world.track.name, seed, lane, world.track.length)
    longest_s = laps * world.track.length / (SLOWEST_MPH * 0.44704)
    rule, lap_began_s = InterventionRule(lane), 0.0
    while world.travelled < laps * world.track.length and world.time < longest_s:
        frame = world.frame() if world.pictures is not None else None
        began = time.perf_counter()
        steering, predicted = policy(frame, world.car.speed_mph)
        latency_ms = 1000 * (time.perf_counter() - began)
        if math.isnan(steering):
            drive.nan_frames += 1
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
        drive.rows.append(row)
        drive.xy.append((world.car.x, world.car.y))
        drive.distance_m.append(world.place.distance)
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
        if world.lap > drive.laps:
            drive.laps = world.lap
            drive.lap_s.append(world.time - lap_began_s)
            lap_began_s = world.time
    drive.driven_m = world.travelled
    return drive


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


def score(drive: ScoredDrive) -> dict[str, float]:
    """The figures of a drive; the same for the same seed, but for `latency_ms`.

    `autonomy` is NVIDIA's, 0..1. `m_per_intervention` is infinite without one; `lap_s` is NaN
    without a whole lap. `steering_per_s` is how much the steering changes in a second, up and down
    added: the smoothness. `stalled` is the share of time below 1 mph.
    """
    cte = np.array([row.cross_track_m for row in drive.rows])
    steering = np.array([row.steering for row in drive.rows])
    mph = np.array([row.speed_mph for row in drive.rows])
    seconds = drive.rows[-1].time_s if drive.rows else math.nan
    interventions = sum(row.intervention for row in drive.rows)
    return {
        "autonomy": autonomy(interventions, seconds),
        "interventions": interventions,
        "m_per_intervention": drive.driven_m / interventions if interventions else math.inf,
        "driven_m": drive.driven_m,
        "driven_s": seconds,
        "laps": drive.driven_m / drive.length_m,
        "lap_s": float(np.mean(drive.lap_s)) if drive.lap_s else math.nan,
        "cte_mean_m": float(np.abs(cte).mean()),
        "cte_rms_m": float(np.sqrt((cte**2).mean())),
        "cte_max_m": float(np.abs(cte).max()),
        "beyond_1m": float((np.abs(cte) > 1).mean()),
        "steering_per_s": float(np.abs(np.diff(steering)).sum() / seconds) if seconds else math.nan,
        "speed_mph": float(mph.mean()),
        "stalled": float((mph < STALLED_BELOW_MPH).mean()),
        "latency_ms": float(np.median([row.latency_ms for row in drive.rows])),
    }

"""A road through points as a test of a driver: pass or fail, as in competitions of road tests."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from zoo.base.command_keys import keys_of
from zoo.base.key_values import check_keys, constructed
from zoo.base.terminal import counted
from zoo.checkpoints.policy_base import Policy
from zoo.driving.drive_record import Drive
from zoo.driving.metrics import cte_max_m
from zoo.driving.run_drives import PolicyMaker, all_drives
from zoo.driving.scenario import Scenario
from zoo.simulator.track_content import road_content

ARRIVED_M = 1.0  # to the road's end
OF_ROADS = ("track", "road", "world", "laps", "start")  # keys that the points stand for


@dataclass(frozen=True)
class DrivenRoad:
    """The outcome of a road test.

    Attributes:
        passed: whether the car reached the road's end within the lane.
        description: why it failed, or that it passed.
        largest_m: largest distance of the car's middle from the lane's middle, in metres.
        seconds: simulated seconds of the drive.
        drive: rows of the drive, and its places `xy` in the points' metres.
    """

    passed: bool
    description: str
    largest_m: float
    seconds: float
    drive: Drive = field(repr=False)


def drive_road(
    driver: str | Policy | PolicyMaker,
    points: Sequence[Sequence[float]],
    width: float = 8.0,
    **keys: Any,
) -> DrivenRoad:
    """Drive an open road once, up to its end or to the first departure from the lane.

    The lane is the whole road, and its middle the line through the points. The same arguments give
    the same outcome to the bit: the software renderer draws, and no clock is read.

    Args:
        driver: path of a checkpoint, a policy, or what makes one.
        points: x and y in metres, or x, y and z, of points along the road's middle.
        width: width of the road in metres, 3..30; 8 m is that of the competitions' roads.
        **keys: keys of `Scenario`, such as `speed` and `margin`.

    Raises:
        InputError: the road cannot be driven (a bend is too tight for the car, or it crosses
            itself), or a value is wrong.
        UsageError: a key is wrong.
    """
    check_keys(keys, [key for key in keys_of(Scenario) if key.name not in OF_ROADS])
    scenario = Scenario(**constructed(Scenario, keys), road=road_content(points, width))
    scenario.check()
    (drive,) = all_drives(driver, [scenario], renderer="software", first_only=True)
    largest_m, arrived = cte_max_m(drive), drive.driven_m > drive.length_m - ARRIVED_M
    if drive.nan_frames:
        reason = f"steered NaN in {counted(drive.nan_frames, 'frame')}"
    elif largest_m > drive.lane_m:
        reason = f"left the lane after {drive.driven_m:.1f} m"
    elif drive.intervention.any() or not arrived:
        reason = f"stood still or turned back after {drive.driven_m:.1f} m"
    else:
        reason = ""
    seconds = float(drive.time_s[-1]) if len(drive) else math.nan
    return DrivenRoad(not reason, reason or "reached the end", largest_m, seconds, drive)

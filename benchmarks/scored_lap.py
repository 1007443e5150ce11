"""Measure the cost of scoring beyond rendering and network: `make bench ONLY=scored_lap`.

It compares the CPU time of a scored drive on the lake with that of rendering the same frames and
running the network on each, on one thread. Weights are random; the car is put back often, which
costs nothing extra.
"""

import time

from benchmarks.material import random_policy
from benchmarks.measuring import Row, medians, ratios, seconds_of, take_turns
from zoo.driving.drive_loop import drive
from zoo.driving.drive_record import Drive
from zoo.driving.open_world import open_world
from zoo.driving.scenario import Scenario
from zoo.simulator.simulated_world import Start

LAPS, SHORT_LAPS = 0.2, 0.02


def measure(short: bool) -> list[Row]:
    """Compare the drive with its parts."""
    laps, rounds = (SHORT_LAPS, 1) if short else (LAPS, 3)
    scenario = Scenario("lake", laps=laps, speed=20.0)
    policy, world = random_policy("nvidia").scored(), open_world(scenario)
    simulated = world.simulated

    def scored() -> float:
        return seconds_of(lambda: drives.append(drive(policy, world, scenario)), time.process_time)

    def in_turns() -> float:
        last, seconds = drives[-1], 0.0
        for distance, row in zip(last.distance_m, last.rows, strict=True):
            simulated.put_back(Start(distance, cte=row.cross_track_m, speed_mph=row.speed_mph))
            seconds += seconds_of(lambda: policy(world.frame(), 20.0), time.process_time)
        return seconds

    drives: list[Drive] = []
    turns = take_turns({"scored s": scored, "in turns s": in_turns}, rounds)
    world.close()
    what = f"{laps:g} scored laps of the lake, nvidia, one core"
    ratio = ratios(turns["scored s"], turns["in turns s"])
    return [Row(what, "rendering and network, frame by frame", ratio, 1.1, False, medians(turns))]

"""Measure the cost of scoring beyond rendering and network: `make bench ONLY=scored_lap`.

It compares the CPU time of a scored drive on the lake with that of rendering the same frames and
running the network on them, each on one thread; `in turns s` is that of both, frame by frame, whose
caches are those of a drive. Weights are random; the car is put back often, which costs nothing
extra.
"""

import time
from functools import partial

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
    frames: list = []

    def scored() -> float:
        return seconds_of(lambda: drives.append(drive(policy, world, scenario)), time.process_time)

    def rendered(network: bool = False) -> float:
        last, seconds = drives[-1], 0.0
        frames.clear()
        for distance, row in zip(last.distance_m, last.rows, strict=True):
            simulated.put_back(Start(distance, cte=row.cross_track_m, speed_mph=row.speed_mph))
            began = time.process_time()
            frames.append(world.frame())
            if network:
                policy(frames[-1], 20.0)
            seconds += time.process_time() - began
        return seconds

    def predicted() -> float:
        return seconds_of(lambda: [policy(frame, 20.0) for frame in frames], time.process_time)

    drives: list[Drive] = []
    apart = {"rendering s": rendered, "network s": predicted}
    together = {"in turns s": partial(rendered, network=True)}
    turns = take_turns({"scored s": scored, **apart, **together}, rounds)
    world.close()
    sums = [a + b for a, b in zip(turns["rendering s"], turns["network s"], strict=True)]
    what = f"{laps:g} scored laps of the lake, nvidia, one core"
    ratio, parts = ratios(turns["scored s"], sums), "rendering alone + network alone"
    return [Row(what, parts, ratio, 1.1, False, medians(turns))]

"""Measure the cost of scoring beyond rendering and network: `python benchmarks/scored_lap.py`.

It compares the CPU time of a scored drive on the lake with that of rendering the same frames and
running the network on them, each on one thread. PilotNet has random weights; the car is put back
often, which costs nothing extra. It also compares the wall time of four drives on four cores with
one on one core.
"""

import tempfile
import time
from pathlib import Path

import torch

from benchmarks.driver import random_checkpoint, random_policy
from benchmarks.timing import Row, compared, median_ratio, medians, run_part, take_turns
from simulator.world import Start
from zoo.base.cores import usable_cores
from zoo.drives.drive_record import Drive
from zoo.worlds.drive_loop import drive
from zoo.worlds.open_world import open_world
from zoo.worlds.run_drives import all_drives
from zoo.worlds.scenario import Scenario

LAPS, SHORT_LAPS = 0.2, 0.02
MANY = 4


def measure(short: bool) -> list[Row]:
    """Measure the two ratios."""
    torch.set_num_threads(1)
    laps, rounds = (SHORT_LAPS, 1) if short else (LAPS, 3)
    scenario = Scenario("lake", laps=laps, speed=20.0)
    policy, world = random_policy("nvidia"), open_world(scenario)
    simulated = world.simulated
    frames: list = []

    def scored() -> float:
        began = time.process_time()
        found.append(drive(policy, world, scenario))
        return time.process_time() - began

    def rendered() -> float:
        last, seconds = found[-1], 0.0
        frames.clear()
        for distance, row in zip(last.distance_m, last.rows, strict=True):
            simulated.put_back(Start(distance, cte=row.cross_track_m, speed_mph=row.speed_mph))
            began = time.process_time()
            frames.append(world.frame())
            seconds += time.process_time() - began
        return seconds

    def predicted() -> float:
        began = time.process_time()
        for frame in frames:
            policy(frame, 20.0)
        return time.process_time() - began

    found: list[Drive] = []
    turns = take_turns(
        {"scored s": scored, "rendering s": rendered, "network s": predicted}, rounds
    )
    world.close()
    sums = [a + b for a, b in zip(turns["rendering s"], turns["network s"], strict=True)]
    what = f"{laps:g} scored laps of the lake, nvidia, one core"
    rows = [
        Row(
            what,
            "rendering alone + network alone",
            median_ratio(turns["scored s"], sums),
            1.2,
            False,
            medians(turns),
        )
    ]
    return rows if usable_cores() < MANY else rows + [_many(short)]


def _many(short: bool) -> Row:
    """Compare four parallel laps, including the start of their processes, with one."""
    laps, rounds = (SHORT_LAPS, 1) if short else (1.0, 1)
    with tempfile.TemporaryDirectory() as folder:
        checkpoint = random_checkpoint(Path(folder))
        scenarios = [Scenario("lake", seed, laps, 20.0) for seed in range(MANY)]

        def one() -> float:
            began = time.perf_counter()
            all_drives(checkpoint, scenarios[:1])
            return time.perf_counter() - began

        def many() -> float:
            began = time.perf_counter()
            all_drives(checkpoint, scenarios, workers=MANY)
            return time.perf_counter() - began

        turns = take_turns({"four s": many, "one s": one}, rounds)
    what = f"four drives of {laps:g} laps on four cores"
    return compared(turns, what, "one on one core", ("four s", "one s"), 1.3, False)


if __name__ == "__main__":
    run_part(measure)

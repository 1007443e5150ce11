"""Measurements of the embedded world: `python benchmarks/worlds.py NAME ...`, one function each."""

import time

import numpy as np

from benchmarks.measuring import print_table, run_named
from simulator.expert import Expert, ExpertSettings
from simulator.road_family import draw_road, family_names, find_family
from simulator.track import Track
from simulator.track_names import track_names
from simulator.world import World as Embedded
from simulator.world import open_world

SLOWEST_MPS = 1.0  # a driver that is slower than this on average is stuck


def roads(count: str = "1000") -> int:
    """Draw roads of each family and let the expert drive them: `roads [ROADS]`.

    It prints the roads drawn per second on one core, and how many of the first roads the expert
    completes without leaving the road. No images are rendered. Seconds are processor time, so that
    other processes do not change them. 1,000 roads of three families take 15 minutes.
    """
    rows, failures = [], []
    for name in family_names():
        family, seeds = find_family(name), range(int(count))
        began = time.process_time()
        drawn = [draw_road(family, seed) for seed in seeds]
        per_second = len(drawn) / (time.process_time() - began)
        # Drawn again, because a driven road keeps a table of its samples, up to 1 MB.
        drives = [drive_road(draw_road(family, seed)) for seed in seeds]
        failed = [
            f"{road.name}: not completed, {most_m:.2f} m off the centreline"
            for road, (complete, most_m) in zip(drawn, drives, strict=True)
            if not complete
        ]
        cells = [name, f"{per_second:.0f}", f"{sum(road.length for road in drawn) / 1000:,.0f}"]
        cells.append(f"{np.mean([road.closed for road in drawn]):.0%}")
        cells.append(f"{len(drawn) - len(failed):,} of {len(drawn):,}")
        rows.append([*cells, f"{max(most_m for _, most_m in drives):.2f}"])
        failures += failed
    print_table(["family", "roads/s", "km", "loops", "expert completes", "max cte, m"], rows)
    print(*failures, sep="\n")
    return int(bool(failures))


def drive_road(road: Track) -> tuple[bool, float]:
    """Let the expert drive a road; return whether it completes it, and its largest error in m."""
    world, expert, most_m = Embedded(road), Expert(road), 0.0
    while not world.is_complete(1.0):
        world.step(*expert(world))
        most_m = max(most_m, abs(world.cte))
        if world.off_road or world.time > road.length / SLOWEST_MPS:
            return False, most_m
    return True, most_m


def expert(*tracks: str) -> None:
    """Measure how well the expert drives: `expert [TRACK...]`.

    It drives ten laps of each track in both directions, without noise and with three seeds of
    noise.
    """
    rows, laps = [], 10
    for track in tracks or track_names():
        for way in (1, -1):
            for noise, seed in ((0.0, 0), (1.0, 1), (1.0, 2), (1.0, 3)):
                world = open_world(track, "none", direction=way)
                driver = Expert(world.track, ExpertSettings(noise=noise, seed=seed))
                world.reset(seed)
                driver.reset(seed)
                errors, off = [], 0
                while not world.is_complete(laps):
                    world.step(*driver(world))
                    errors.append(abs(world.cte))
                    off += world.off_road
                cells = [f"{np.mean(errors):.3f}", f"{max(errors):.2f}", f"{world.time / laps:.1f}"]
                rows.append([track, f"{way:+d}", f"{noise:g}", seed, *cells, off])
    head = ["track", "direction", "noise", "seed", "mean cte, m", "max cte, m", "lap, s"]
    print_table([*head, "off road"], rows)


if __name__ == "__main__":
    run_named(expert, roads)

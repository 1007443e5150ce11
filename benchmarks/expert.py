"""Measure how well the expert drives: `python benchmarks/expert.py`.

It drives ten laps of each track in both directions, without noise and with three seeds of noise.
Then it renders and drives two seconds from 200 random starts in random weather. With tracks' names,
it measures these tracks only.
"""

import sys

import numpy as np
from rich.console import Console
from rich.table import Table

from simulator.expert import Expert, ExpertSettings
from simulator.track_names import track_names
from simulator.world import Start, World, open_world

LAPS, DAYS = 10, 200


def drive_laps(world: World, expert: Expert, seed: int) -> tuple[np.ndarray, int]:
    """Return the frames' cross-track errors, float [N], in metres, and the number off the road."""
    world.reset(seed)
    expert.reset(seed)
    errors, off = [], 0
    while not world.is_complete(LAPS):
        world.step(*expert(world))
        errors.append(abs(world.cte))
        off += world.off_road
    return np.array(errors), off


def main() -> None:
    """Print both tables."""
    console = Console()
    table = Table(
        "track", "direction", "noise", "seed", "mean cte, m", "max cte, m", "lap, s", "off road"
    )
    names = sys.argv[1:] or track_names()
    for track in names:
        for way in (1, -1):
            for noise, seed in ((0.0, 0), (1.0, 1), (1.0, 2), (1.0, 3)):
                world = open_world(track, "none", direction=way)
                expert = Expert(world.track, ExpertSettings(noise=noise, seed=seed))
                errors, off = drive_laps(world, expert, seed)
                figures = (
                    f"{errors.mean():.3f}",
                    f"{errors.max():.2f}",
                    f"{world.time / LAPS:.1f}",
                )
                table.add_row(track, f"{way:+d}", f"{noise:g}", str(seed), *figures, str(off))
    console.print(table)
    for track in names:
        world = open_world(track, "software")
        expert, off = Expert(world.track), 0
        for seed in range(DAYS):
            rng = np.random.default_rng(seed)
            where = world.draw_distance(rng)
            start = Start(where, rng.uniform(-1, 1), rng.uniform(-5, 5), 15)
            world.reset(seed, start, "random")
            expert.reset(seed)
            for _ in range(30):
                world.step(*expert(world))
                off += world.off_road
            if world.frame().std() < 5:
                console.print(f"{track}: seed {seed}: the frame is nearly blank")
        console.print(
            f"{track}: {DAYS} random starts and weathers driven, {off} frames off the road"
        )


if __name__ == "__main__":
    main()

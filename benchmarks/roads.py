"""Draw roads of each family and let the expert drive them: `python benchmarks/roads.py [ROADS]`.

It prints the roads drawn per second on one core, and how many of the first 1,000 roads the expert
completes without leaving the road. No images are rendered. Seconds are processor time, so that
other processes do not change them. 1,000 roads of three families take 15 minutes.
"""

import sys
import time
from dataclasses import dataclass

import numpy as np
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from simulator.expert import Expert
from simulator.road_family import RoadFamily, draw_road, family_names, find_family
from simulator.track import Track
from simulator.world import World

ROADS = 1000
SLOWEST_MPS = 1.0  # a driver that is slower than this on average is stuck


@dataclass(frozen=True)
class ExpertDrive:
    """The expert's drive along one road: whether it is complete, and its largest error."""

    road: str
    complete: bool
    most_cte_m: float


def drive_expert(road: Track) -> ExpertDrive:
    """Drive the expert to the end of a road, or to where it leaves the road or is stuck."""
    world, expert, most = World(road), Expert(road), 0.0
    while not world.is_complete(1.0):
        world.step(*expert(world))
        most = max(most, abs(world.cte))
        if world.off_road or world.time > road.length / SLOWEST_MPS:
            return ExpertDrive(road.name, False, most)
    return ExpertDrive(road.name, True, most)


def measure_family(family: RoadFamily, roads: int, progress: Progress) -> tuple[list[str], list]:
    """Return a row of the table, and the drives that the expert did not complete."""
    began = time.process_time()
    drawn = [draw_road(family, seed) for seed in range(roads)]
    per_second = roads / (time.process_time() - began)
    seeds = progress.track(range(roads), description=family.name)
    # Drawn again, because a driven road keeps a table of its samples, up to 1 MB.
    drives = [drive_expert(draw_road(family, seed)) for seed in seeds]
    failed = [drive for drive in drives if not drive.complete]
    row = [
        family.name,
        f"{per_second:.0f}",
        f"{sum(road.length for road in drawn) / 1000:,.0f}",
        f"{np.mean([road.closed for road in drawn]):.0%}",
        f"{roads - len(failed):,} of {roads:,}",
        f"{max(drive.most_cte_m for drive in drives):.2f}",
    ]
    return row, failed


def main() -> int:
    """Print the table and the roads that the expert did not complete."""
    roads = int(sys.argv[1]) if len(sys.argv) > 1 else ROADS
    console = Console()
    table = Table("family", "roads/s", "km", "loops", "expert completes", "max cte, m")
    failures: list[ExpertDrive] = []
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        for name in family_names():
            row, failed = measure_family(find_family(name), roads, progress)
            table.add_row(*row)
            failures += failed
    console.print(table)
    for drive in failures:
        console.print(f"{drive.road}: not completed, {drive.most_cte_m:.2f} m off the centreline")
    return int(bool(failures))


if __name__ == "__main__":
    sys.exit(main())

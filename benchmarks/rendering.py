"""Measure the simulator's frames per second on one core: `make bench ONLY=rendering`."""

import time

from benchmarks.measuring import Row, medians, take_turns
from datamodules.driving_log import CAMERAS
from simulator.world import Start, World, open_world

FRAMES, RATE = 150, 15  # the simulator sends 15 frames per second


def frames_per_second(world: World, cameras: tuple[str, ...]) -> float:
    """Return how many frames of some cameras are drawn per second, at places along the lap."""
    began = time.perf_counter()
    for number in range(FRAMES):
        world.put_back(Start(number * world.track.length / FRAMES))
        for camera in cameras:
            world.frame(camera)
    return FRAMES / (time.perf_counter() - began)


def measure(short: bool) -> list[Row]:
    """Measure frames per second of the lake relative to the simulator's 15."""
    world = open_world("lake", renderer="software")
    measures = {
        "1 camera": lambda: frames_per_second(world, ("center",)),
        "3 cameras": lambda: frames_per_second(world, CAMERAS),
    }
    rates = medians(take_turns(measures, 1 if short else 3))
    return [
        Row(f"drawing the lake, {name}", f"{RATE} frames/s", [rate / RATE], figures={"/s": rate})
        for name, rate in rates.items()
    ]

"""Measure the simulator's frames per second on one core: `python benchmarks/rendering.py [parts]`.

The figures are medians of five rounds, with turns between one and three cameras, both tracks, both
qualities, and physics without rendering. `parts` measures the processor time of a frame's parts.
"""

import statistics
import sys
import time
from collections import Counter
from collections.abc import Callable
from functools import partial

from benchmarks.measuring import print_table
from benchmarks.timing import Row, run_part, take_turns
from simulator.recorder import encode
from simulator.rig import CAMERAS
from simulator.world import Start, World, open_world

FRAMES, ROUNDS = 150, 5
TRACKS = ("lake", "mountain")


def per_second(action: Callable[[int], object]) -> float:
    """Return how often an action runs per second."""
    began = time.perf_counter()
    for number in range(FRAMES):
        action(number)
    return FRAMES / (time.perf_counter() - began)


def drawing(world: World, cameras: tuple[str, ...]) -> Callable[[int], object]:
    """Return a function that draws frames at places along the lap."""

    def draw(number: int) -> None:
        world.put_back(Start(number * world.track.length / FRAMES))
        for camera in cameras:
            world.frame(camera)

    return draw


def measure(short: bool) -> list[Row]:
    """Measure, for `make bench`, frames per second relative to the simulator's 15."""
    world = open_world("lake", renderer="software")
    kinds = {"1 camera": drawing(world, ("center",)), "3 cameras": drawing(world, CAMERAS)}
    rows = []
    for name, draw in kinds.items():
        rate = statistics.median(per_second(draw) for _ in range(1 if short else 3))
        rows.append(
            Row(f"drawing the lake, {name}", "15 frames/s", rate / 15, figures={"/s": rate})
        )
    return rows


def parts_of_frame(world: World) -> dict[str, float]:
    """Return the processor time of each part of a recorded frame in ms."""
    renderer, spent = world.renderer, Counter()

    def timed(part: str, action: Callable, *arguments: object) -> object:
        began = time.process_time()
        result = action(*arguments)
        spent[part] += time.process_time() - began
        return result

    for number in range(FRAMES):
        world.put_back(Start(number * world.track.length / FRAMES))
        for camera in CAMERAS:
            timed("camera's place", renderer.place_camera, renderer.camera, world.pose(), camera)
            timed("renderer", renderer.engine.renderFrame)
            frame = timed("copy", renderer.read_frame)
            frame = timed("bonnet", renderer.air, frame, camera, number)
            timed("JPEG", encode, frame)
        for _ in CAMERAS:
            timed("step of the world", world.step, 0.0, 0.1)
    return {part: 1000 * seconds / FRAMES / len(CAMERAS) for part, seconds in spent.items()}


def print_parts() -> None:
    """Print the parts of a frame on both tracks."""
    spent = [parts_of_frame(open_world(track, renderer="software")) for track in TRACKS]
    rows = [[part, *(f"{track[part]:.2f}" for track in spent)] for part in spent[0]]
    print_table(["part of a frame", *(f"{track}, ms" for track in TRACKS)], rows)


def main() -> None:
    """Print the table."""
    measured: dict[str, Callable[[], float]] = {}
    for track in TRACKS:
        for quality in ("full", "simple"):
            world = open_world(track, renderer="software", quality=quality)
            for count, cameras in (("1 camera", ("center",)), ("3 cameras", CAMERAS)):
                draw = partial(per_second, drawing(world, cameras))
                measured[f"{track}, {quality}, {count}"] = draw
        physics = open_world(track, renderer="none")
        physics.reset(0, Start(speed_mph=20))
        step = partial(per_second, lambda _, world=physics: world.step(0.0, 0.2))
        measured[f"{track}, physics alone"] = step
    rows = []
    for name, values in take_turns(measured, ROUNDS).items():
        rates = (
            statistics.median(values),
            min(values),
            max(values),
            statistics.median(values) / 15,
        )
        rows.append([name, *(f"{rate:.0f}" for rate in rates)])
    print_table(["what", "frames/s", "lowest", "highest", "times real time at 15 Hz"], rows)


if __name__ == "__main__":
    if sys.argv[1:] == ["parts"]:
        print_parts()
    else:
        run_part(measure) if len(sys.argv) > 1 else main()

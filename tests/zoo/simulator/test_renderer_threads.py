"""Renderers of several threads, such as those of a script's `ThreadPoolExecutor`."""

from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from threading import Barrier, BrokenBarrierError

from zoo.simulator.simulated_world import World, open_world


def test_two_threads_never_draw_at_once_which_gives_other_frames() -> None:
    worlds = [open_world("lake", "software", "simple") for _ in range(2)]
    for world in worlds:
        world.reset(0)
        world.frame()
    drawing, met = Barrier(2), []

    class Engine:
        def renderFrame(self) -> None:  # noqa: N802
            with suppress(BrokenBarrierError):
                met.append(drawing.wait(0.5))

    def draw(world: World) -> None:
        world.drawing().engine = Engine()
        world.frame()

    with ThreadPoolExecutor(2) as threads:
        list(threads.map(draw, worlds))
    assert not met

"""Frames per second and processor time of each world, a part of `make bench`."""

import math
import subprocess
import time
from contextlib import ExitStack
from functools import partial
from importlib.util import find_spec

import psutil

from benchmarks.measuring import Row, medians, take_turns
from datamodules.driving_log import CAMERAS
from zoo.base.child_process import end_module, start_module
from zoo.driving.open_world import WORLDS, open_world
from zoo.driving.scenario import Scenario
from zoo.driving.world import World

FRAMES, RATE = 150, 15  # the simulator of 2016 sends 15 frames per second
LEAST = 10  # times its rate, and half of it where a frame is three, or where the world is slow
HALF = ("3 cameras", "CarRacing-v3")


def measure(short: bool) -> list[Row]:
    """Measure frames per second of each world relative to the 15 of the simulator of 2016.

    An expert steers where the world has one. The processor time is that of all processes: the
    Donkeycar simulator is one of its own. CarRacing is measured if Box2D is installed.
    """
    with ExitStack() as stack:
        scenarios = {
            "the lake": Scenario(),
            "the lake, 3 cameras": Scenario(),
            "udacity_mountain": Scenario("udacity_mountain"),
            "the lake, quality=fast": Scenario(quality="fast"),
            "the lake, quality=fast, 3 cameras": Scenario(quality="fast"),
        }
        if "donkey" in WORLDS:  # of an extra
            serve = ("zoo.commands.simulator", "serve", "port=0", "rate=max")
            pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL, "text": True}
            server = start_module(*serve, **pipes)
            stack.callback(end_module, server)
            port = server.stdout.readline().split(":")[-1].split()[0]
            address = f"127.0.0.1:{port}/generated_track"
            scenarios["the lake through Donkeycar's protocol"] = Scenario(address, world="donkey")
        scenarios["the lake through Gymnasium"] = Scenario(world="gymnasium:drivezoo/Lake-v0")
        if find_spec("Box2D"):
            scenarios["Gymnasium's CarRacing-v3"] = Scenario(world="gymnasium:CarRacing-v3")
        costs: dict[str, list[float]] = {name: [] for name in scenarios}
        measures = {}
        for name, scenario in scenarios.items():
            world = open_world(scenario)
            stack.callback(world.close)
            cameras = CAMERAS if "3 cameras" in name else CAMERAS[:1]
            measures[name] = partial(frames_per_second, world, scenario, cameras, costs[name])
        rates = medians(take_turns(measures, 1 if short else 3))
    return [
        Row(
            f"driving in {name}",
            f"{RATE} frames/s",
            [rate / RATE],
            LEAST / 2 if name.endswith(HALF) else LEAST,
            figures={"/s": rate, "CPU ms a frame": 1000 * medians(costs)[name]},
        )
        for name, rate in rates.items()
    ]


def frames_per_second(
    world: World, scenario: Scenario, cameras: tuple[str, ...], cpu_s: list[float]
) -> float:
    """Return how many frames are driven per second; append the processor seconds of a frame."""
    state = world.reset(scenario)
    began, cpu_began = time.perf_counter(), processor_s()
    for _ in range(FRAMES):
        for camera in cameras:
            world.frame(camera)
        steering = world.expert_steering()
        state = world.step(0.0 if math.isnan(steering) else steering, 0.3)
        if state.done or state.contact:
            world.reset(scenario)
    cpu_s.append((processor_s() - cpu_began) / FRAMES)
    return FRAMES / (time.perf_counter() - began)


def processor_s() -> float:
    """Return the processor seconds of this process and of those that it started."""
    process = psutil.Process()
    times = [child.cpu_times() for child in (process, *process.children(recursive=True))]
    return sum(cpu.user + cpu.system for cpu in times)

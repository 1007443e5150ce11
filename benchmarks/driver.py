"""Measure the driver's throughput and latency per network: `make bench ONLY=driver`.

The client has the original's protocol and 60 frames per second. Its two loops send at most 120
telemetry messages per second, each frame twice. Latency is the time from the last byte of a frame
to its written reply.
"""

import multiprocessing
import tempfile
import time
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from benchmarks.material import random_policy
from benchmarks.measuring import Row
from zoo.checkpoints.engine import Engine
from zoo.simulator.legacy_socket import OPENED, LegacySocket
from zoo.simulator.telemetry import make_telemetry

FPS, SECONDS = 60, 1.0
NETWORKS = ("nvidia", "commaai", "cnn_gru")  # the last has a memory
AIM, SLOW_AIM = 0.98, 0.95  # all messages but for those on their way; not slower than PyTorch
SLOW = ("efficientnet_lite0", "vgg")  # compared with PyTorch
TORCH = " on torch"


def measure(short: bool) -> list[Row]:
    """Compare the driver of some networks with the demand of two loops at 60 frames per second.

    A network that is too slow for these is compared with PyTorch, whose engine it replaces. One
    process serves all networks, because torch loads slowly.
    """
    slow = () if short else SLOW
    engines: dict[str, Engine] = dict.fromkeys((*NETWORKS, *slow), "auto")
    engines |= dict.fromkeys((f"{name}{TORCH}" for name in slow), "torch")
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=serve_each, args=(engines, theirs))
    process.start()
    rates, figures = {}, {}
    for name in engines:
        rates[name] = send_telemetry(ours.recv(), SECONDS)
        ours.send("stop")
        latency = {f"{key} ms": value for key, value in ours.recv().items()}
        figures[name] = {"telemetry/s": rates[name], **latency}
    process.join()
    rows = []
    for name in filter(lambda name: not name.endswith(TORCH), engines):
        asked, reference, aim = 2 * FPS, f"two loops at {FPS} fps, answered at once", AIM
        if name in SLOW:
            asked, reference, aim = rates[f"{name}{TORCH}"], "the same on PyTorch", SLOW_AIM
        what = f"the driver with {name}, telemetry answered"
        rows.append(Row(what, reference, [rates[name] / asked], aim, figures=figures[name]))
    return rows


def send_telemetry(port: int, seconds: float) -> float:
    """Simulate 60 frames per second; return the telemetry messages answered per second.

    Each frame sends one message for each reply since the last frame.
    """
    messages = noise_telemetry(30)
    client = LegacySocket(f"http://127.0.0.1:{port}")
    waiting, answered, tick = 1, 0, 0
    began = time.perf_counter()
    while (now := time.perf_counter()) - began < seconds:
        for _ in range(waiting):
            client.emit("telemetry", messages[tick % len(messages)])
        waiting, tick = 0, tick + 1
        while (left_s := began + tick / FPS - now) > 0:
            events = client.events(left_s)
            waiting += len(events)
            answered += sum(name != OPENED for name, _ in events)
            now = time.perf_counter()
    client.close()
    return answered / seconds


def noise_telemetry(count: int) -> list[dict]:
    """Return telemetry messages with images of coloured squares."""
    rng = np.random.default_rng(0)
    frames = (rng.integers(0, 255, (20, 40, 3)).repeat(8, 0).repeat(8, 1) for _ in range(count))
    return [make_telemetry(frame.astype(np.uint8), 0.0, 0.0, 9.0, False) for frame in frames]


def serve_each(engines: dict[str, Engine], pipe: Connection) -> None:
    """Serve networks with random weights; send the port, then the latency of each, in ms."""
    from zoo.base.notices import Notices
    from zoo.driving.speed_controller import PI, SteeringFilter
    from zoo.server.drive_writer import BackgroundWriter
    from zoo.server.driver import Driver
    from zoo.server.server import DriveServer, listen

    for name, engine in engines.items():
        notices = Notices(lambda line: None)
        with tempfile.TemporaryDirectory() as folder:
            writer = BackgroundWriter(Path(folder) / "drive", notices)
            policy, speed = random_policy(name.removesuffix(TORCH), engine), PI(9, 0.1, 0.002)
            driver = Driver(policy, speed, SteeringFilter(), writer, notices)
            server = DriveServer(driver, listen("127.0.0.1", 0))
            server.serve(lambda server=server: pipe.send(server.port), pipe.poll)
            pipe.recv()
            server.close()
            writer.close({})
        pipe.send(driver.tally.figures()["latency_percentiles_ms"])

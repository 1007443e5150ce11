"""`python benchmarks/driver.py [SECONDS]`: telemetry served a second, and latency, per network.

The client speaks the original's protocol and runs at 60 frames a second: its two loops make 120
telemetry a second at most. Latency is from a frame's last byte read to its reply written.
"""

import json
import multiprocessing
import sys
import tempfile
import time
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table
from timing import Row, run_part

from simulator.legacy_socket import OPENED, LegacySocket
from simulator.telemetry import make_telemetry
from zoo.config import choices, compose_config

FPS, SECONDS, BENCH_SECONDS = 60, 8.0, 4.0
CONSTANT = "a constant"


def main(seconds: float) -> None:
    """Print the table."""
    table = Table("network", "telemetry/s", "p50 ms", "p95 ms", "p99 ms")
    for name in (CONSTANT, *choices("model")):
        rate, latency = drive(name, seconds)
        table.add_row(name, f"{rate:.0f}", *(f"{value:.1f}" for value in latency.values()))
    Console().print(table)


def measure(short: bool) -> list[Row]:
    """For `make bench`: the driver with every network, beside what two loops of 60 fps can ask for,
    and beside nvidia's forward pass."""
    asked = f"two loops at {FPS} fps, answered at once"
    rows, latencies = [], {}
    for name in ("nvidia",) if short else (CONSTANT, *choices("model")):
        rate, latencies[name] = drive(name, 1.0 if short else BENCH_SECONDS)
        figures = {"telemetry/s": rate}
        figures |= {f"{key} ms": value for key, value in latencies[name].items()}
        what = f"the driver with {name}, telemetry answered"
        rows.append(Row(what, asked, rate / (2 * FPS), figures=figures))
    forward, median = forward_ms("nvidia", 20 if short else 500), latencies["nvidia"]["p50"]
    beside = {"driver ms": median, "forward ms": forward}
    what = "frame received to reply sent, nvidia, median"
    return [*rows, Row(what, "the forward pass alone", median / forward, 1.5, False, beside)]


def forward_ms(name: str, repeats: int) -> float:
    """The median time of a network's forward pass of one picture, on one thread."""
    import torch

    policy, times = random_policy(name), []
    height, width, channels = policy.view.shape
    picture = torch.zeros(1, channels, height, width, dtype=torch.uint8)
    with torch.inference_mode():
        for _ in range(repeats):
            began = time.perf_counter()
            policy.network(picture)
            times.append(1000 * (time.perf_counter() - began))
    return float(np.median(times))


def drive(name: str, seconds: float) -> tuple[float, dict[str, float]]:
    """Telemetry a second that the driver with a network answers, and its latencies in ms."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=serve, args=(name, theirs))
    process.start()
    rate = send_telemetry(ours.recv(), seconds)
    ours.send("stop")
    latency = ours.recv()["latency_ms"]
    process.join()
    return rate, latency


def send_telemetry(port: int, seconds: float) -> float:
    """Be a simulator of 60 frames a second: in each, one telemetry for each reply that came since
    the last. Returns telemetry per second that was answered."""
    rng = np.random.default_rng(0)
    frames = [rng.integers(0, 255, (20, 40, 3)).repeat(8, 0).repeat(8, 1) for _ in range(30)]
    messages = [make_telemetry(frame.astype(np.uint8), 0.0, 0.0, 9.0, False) for frame in frames]
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


def serve(name: str, pipe: Connection) -> None:
    """The driver with a network of random weights; sends its port, and its figures at the end."""
    from zoo.driving.driver import Driver
    from zoo.driving.notices import Notices
    from zoo.driving.scribe import Scribe
    from zoo.driving.server import DriveServer, listen
    from zoo.driving.speed_controller import PI
    from zoo.driving.steering_filter import SteeringFilter

    notices = Notices(lambda line: None)
    with tempfile.TemporaryDirectory() as folder:
        scribe = Scribe(Path(folder) / "drive", notices)
        policy = (lambda frame, speed: (0.1, None)) if name == CONSTANT else random_policy(name)
        driver = Driver(policy, PI(9, 0.1, 0.002), SteeringFilter(), scribe, notices)
        server = DriveServer(driver, listen("127.0.0.1", 0))
        server.serve(lambda: pipe.send(server.port), pipe.poll)
        server.close()
        scribe.close({})
    pipe.send(json.loads(json.dumps(driver.tally.figures())))


def random_policy(name: str) -> object:
    """The network of `model=name`, not trained, as a policy on one thread."""
    import torch

    from datamodules.view import View
    from zoo.checkpoint import Checkpoint, make_network
    from zoo.policy import Policy

    torch.set_num_threads(1)
    config = compose_config([f"model={name}"])
    model = config["model"]
    view = View(config["data"]["crop"], model["colour"], model["size"])
    policy = Policy(Checkpoint(make_network(model, view).eval(), view, config, {}))
    for _ in range(3):
        policy(np.zeros((160, 320, 3), np.uint8), 0.0)
    return policy


if __name__ == "__main__":
    as_part = any(one == "short" or one.startswith("out=") for one in sys.argv[1:])
    run_part(measure) if as_part else main(float(sys.argv[1]) if len(sys.argv) > 1 else SECONDS)

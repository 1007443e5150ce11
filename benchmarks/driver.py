"""Measure the driver's throughput and latency per network: `python benchmarks/driver.py [SECONDS]`.

The client has the original's protocol and 60 frames per second. Its two loops send at most 120
telemetry messages per second, each frame twice. Latency is the time from the last byte of a frame
to its written reply.
"""

import multiprocessing
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path

import numpy as np

from benchmarks.measuring import print_table
from benchmarks.timing import Row, median_ratio, medians, run_part
from simulator.legacy_socket import OPENED, LegacySocket
from simulator.telemetry import make_telemetry
from zoo.cli.compose import choices, compose_config

FPS, SECONDS, BENCH_SECONDS = 60, 8.0, 0.7
CONSTANT = "a constant"
TURNS = 3  # turns of nvidia in the driver and alone


@dataclass(frozen=True)
class Driven:
    """Figures of a driver.

    Attributes:
        rate: telemetry messages answered per second.
        latency: percentiles of the latency in ms.
        looked: median latency of replies with a forward pass, in ms; NaN without a network.
        forward: median of that forward pass, in ms; NaN without a network.
    """

    rate: float
    latency: dict[str, float]
    looked: float
    forward: float


def main(seconds: float) -> None:
    """Print the table."""
    names = (CONSTANT, *choices("model"))
    rows = []
    for name, drive in zip(names, drive_each(names, seconds), strict=True):
        times = (*drive.latency.values(), drive.forward)
        rows.append([name, f"{drive.rate:.0f}", *(f"{ms:.1f}" for ms in times)])
    print_table(["network", "telemetry/s", "p50 ms", "p95 ms", "p99 ms", "forward ms"], rows)


def measure(short: bool) -> list[Row]:
    """Measure for `make bench`.

    The driver with every network is compared with the demand of two loops at 60 frames per second,
    and nvidia's latency with its forward pass.
    """
    asked = f"two loops at {FPS} fps, answered at once"
    seconds, turns = (1.0, 1) if short else (BENCH_SECONDS, TURNS)
    others = [] if short else [CONSTANT, *(name for name in choices("model") if name != "nvidia")]
    # The last turns are nvidia's; after each one its forward pass is timed alone.
    names = [*others, *["nvidia"] * turns]
    drives = drive_each(names, seconds)
    forward_ms("nvidia", 20)  # imports torch while the other process does, too
    found: dict[str, Driven] = {}
    ours: list[Driven] = []
    warm: list[float] = []
    alone: list[float] = []
    for name, drive in zip(names, drives, strict=True):
        found[name] = drive
        if name == "nvidia":
            ours.append(drive)
            warm.append(forward_ms("nvidia", 20 if short else 300))
            alone.append(forward_ms("nvidia", 20 if short else 60, 1 / FPS))
    rows = [
        Row(
            f"the driver with {name}, telemetry answered",
            asked,
            drive.rate / (2 * FPS),
            figures={"telemetry/s": drive.rate, **{f"{k} ms": v for k, v in drive.latency.items()}},
        )
        for name, drive in sorted(found.items())
    ]
    turns_ms = {
        "driver ms": [drive.looked for drive in ours],
        "forward in the driver ms": [drive.forward for drive in ours],
        f"forward, {FPS} a second ms": alone,
        "forward, warm ms": warm,
    }
    replied = turns_ms["driver ms"]
    what = "new frame received to reply sent, nvidia"
    paced = f"the forward pass alone, {FPS} a second"
    ratio = median_ratio(replied, alone)
    return [
        *rows,
        Row(what, paced, ratio, 1.5, False, medians(turns_ms)),
        Row(what, "the forward pass alone, one after the other", median_ratio(replied, warm)),
    ]


def forward_ms(name: str, repeats: int, pause_s: float = 0.0) -> float:
    """Return the median time of a forward pass of one image on one thread, in ms.

    During pauses the weights leave the processor's caches, and the processor lowers its clock.
    """
    import torch

    from zoo.models.memory import frame_outputs

    policy, times = random_policy(name), []
    height, width, channels = policy.view.shape
    image = torch.zeros(1, channels, height, width, dtype=torch.uint8)
    with torch.inference_mode():
        for _ in range(repeats):
            if pause_s:
                time.sleep(pause_s)
            began = time.perf_counter()
            frame_outputs(policy.network, image)
            times.append(1000 * (time.perf_counter() - began))
    return float(np.median(times))


def drive_each(names: Sequence[str], seconds: float) -> Iterator[Driven]:
    """Return the figures of each network, driven in one process, because torch loads slowly.

    The process starts at once, and waits for each network to be asked for.
    """
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=serve_each, args=(list(names), theirs))
    process.start()
    return _driven(names, seconds, process, ours)


def _driven(
    names: Sequence[str], seconds: float, process: BaseProcess, ours: Connection
) -> Iterator[Driven]:
    for _ in names:
        rate = send_telemetry(ours.recv(), seconds)
        ours.send("stop")
        yield Driven(rate, *ours.recv())
        ours.send("go on")
    process.join()


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


def serve_each(names: list[str], pipe: Connection) -> None:
    """Serve networks with random weights; send the port, then the figures of each."""
    for name in names:
        serve(name, pipe)
        pipe.recv()


def serve(name: str, pipe: Connection) -> None:
    from zoo.drive.drive_writer import BackgroundWriter
    from zoo.drive.driver import Driver
    from zoo.drive.notices import Notices
    from zoo.drive.server import DriveServer, listen
    from zoo.drives.speed_controller import PI, SteeringFilter

    notices, times, looked = Notices(lambda line: None), [], []
    with tempfile.TemporaryDirectory() as folder:
        writer = BackgroundWriter(Path(folder) / "drive", notices)
        policy = (lambda frame, speed: (0.1, None)) if name == CONSTANT else random_policy(name)
        if name != CONSTANT:
            policy.forward = timed(policy.forward, times)
        driver = Driver(policy, PI(9, 0.1, 0.002), SteeringFilter(), writer, notices)
        driver.sent = noting_looks(driver.sent, times, looked)
        server = DriveServer(driver, listen("127.0.0.1", 0))
        server.serve(lambda: pipe.send(server.port), pipe.poll)
        pipe.recv()
        server.close()
        writer.close({})
    found = [float(np.median(values)) if values else float("nan") for values in (looked, times)]
    pipe.send((driver.tally.figures()["latency_percentiles_ms"], found[0], 1000 * found[1]))


def noting_looks(sent: Callable, times: list[float], looked: list[float]) -> Callable:
    """Wrap `Driver.sent` to keep the latency of replies that had a forward pass."""

    def call(reply: object, latency_ms: float) -> None:
        if len(times) > call.before:
            looked.append(latency_ms)
        call.before = len(times)
        sent(reply, latency_ms)

    call.before = 0
    return call


def timed(function: Callable, times: list[float]) -> Callable:
    """Wrap a function so that it adds the seconds of each call to `times`."""

    def call(*arguments: object) -> object:
        began = time.perf_counter()
        result = function(*arguments)
        times.append(time.perf_counter() - began)
        return result

    return call


def random_policy(name: str) -> object:
    """Return the untrained network of `model=name` as a policy on one thread."""
    import torch

    from zoo.checkpoints.checkpoint import Checkpoint
    from zoo.checkpoints.policy import CheckpointPolicy
    from zoo.models.make_network import make_network, view_of

    torch.set_num_threads(1)
    config = compose_config([f"model={name}"])
    view = view_of(config["model"], config["data"]["crop"])
    network = make_network(config["model"], view).eval()
    policy = CheckpointPolicy(Checkpoint(network, view, config, {}))
    for _ in range(3):
        policy(np.zeros((160, 320, 3), np.uint8), 0.0)
    return policy


def random_checkpoint(folder: Path) -> str:
    """Write a checkpoint of nvidia with random weights; return its path."""
    import torch

    from zoo.checkpoints.checkpoint import PREFIX, make_card

    policy = random_policy("nvidia")
    weights = {f"{PREFIX}{key}": value for key, value in policy.network.state_dict().items()}
    card = make_card(policy.config, policy.view, {"fingerprint": "0" * 16, "rows": 10})
    torch.save({"state_dict": weights, "drivezoo": card, "epoch": 0}, folder / "random.ckpt")
    return str(folder / "random.ckpt")


if __name__ == "__main__":
    as_part = any(word == "short" or word.startswith("out=") for word in sys.argv[1:])
    run_part(measure) if as_part else main(float(sys.argv[1]) if len(sys.argv) > 1 else SECONDS)

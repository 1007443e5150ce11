"""Measure training nvidia, whole runs and bare loops: `make bench ONLY=training`.

Five processes take turns: `drivezoo train`, epoch by epoch; a bare loop with the same network and
settings on tensors in memory; that loop with torch's defaults; and a loop fed by a DataLoader,
whose four workers decode, resize and augment sample by sample; and the best matrix product in 32
bits, which is the machine's own limit. Threads spin while they wait,
torch's default; those of `drivezoo train` sleep soon (`zoo.training.host_settings`).
"""

import itertools
import multiprocessing
import os
import time
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection

import torch
from torch.utils.flop_counter import FlopCounterMode

from benchmarks import material
from benchmarks.measuring import Row, compared, contestants, take_turns
from datamodules.batches import Batch
from datamodules.view import View
from zoo.models.network_facts import facts_of
from zoo.training.host_settings import multiplies_bf16

BATCH, WORKERS, ROWS = 64, 4, 2_000
ROUND_S = 1.0  # duration of a loop, whatever the machine's load
HALF = "zoo, bf16/s"
LIMIT, FLOPS, SIDE = "product FLOP/s", "bare loop FLOP/s", 1024
TIMES = 10  # of each product; the fastest counts


def measure(short: bool) -> list[Row]:
    """Compare `drivezoo train` with DataLoader and bare loop, and the latter with torch's defaults.

    On processors with bf16 instructions `drivezoo train` is also measured in bf16.
    """
    batches, rounds = (2, 1) if short else (16, 3)
    seconds = 0.1 if short else ROUND_S
    targets = {
        "zoo/s": (run_zoo, batches),
        "bare loop/s": (run_bare, seconds, True),
        "bare by default/s": (run_bare, seconds, False),
        "sample by sample/s": (run_samples, seconds),
        LIMIT: (run_product, "cpu", 64 if short else SIDE, torch.float32),
    }
    if multiplies_bf16():
        targets[HALF] = run_zoo, batches, "bf16-mixed"
    material.linked_recording(ROWS)  # created once, before the processes need it
    with contestants(targets, asleep=("zoo/s", HALF)) as measures:
        speeds = take_turns(measures, rounds)
    what = f"training nvidia, batch {BATCH}, augmented"
    loader = f"DataLoader, {WORKERS} workers, sample by sample"
    whole = "the same, a whole run after start-up"
    memory = "a bare loop on tensors in memory, same settings"
    bare = "that bare loop: memory kept, channels last, fused Adam, our dropout"
    defaults = "eager, torch's defaults"
    per_sample = flops_of_sample("nvidia")
    speeds[FLOPS] = [per_sample * speed for speed in speeds["bare loop/s"]]
    share = "operations per second of that bare loop"
    rows = [
        compared(speeds, what, loader, ("zoo/s", "sample by sample/s"), 2.2),
        compared(speeds, whole, memory, ("zoo/s", "bare loop/s"), 0.9),
        compared(speeds, bare, defaults, ("bare loop/s", "bare by default/s"), 1.75),
        compared(speeds, share, "best matrix product", (FLOPS, LIMIT), 0.3),
    ]
    if HALF in speeds:
        rows.insert(1, compared(speeds, f"{what}, bf16", loader, (HALF, "sample by sample/s"), 3.6))
    return rows


def run_zoo(pipe: Connection, batches: int, precision: str = "32-true") -> None:
    """Run `drivezoo train` in a precision; a round is one or two epochs.

    Its output is discarded.
    """
    # It imports Lightning, which other targets do not need.
    from benchmarks.training_callbacks import train_by_turns

    config = material.config_for(
        material.linked_recording(ROWS),
        material.AUGMENT,
        "model=nvidia",
        "callbacks=published",
        f"data.batch_size={BATCH}",
        f"data.samples_per_epoch={batches * BATCH}",
        "trainer.max_epochs=10000",
        "trainer.accelerator=cpu",
        f"trainer.precision={precision}",
    )
    train_by_turns(pipe, config, material.OUT / f"run-{precision}")


def run_bare(pipe: Connection, seconds: float, tuned: bool) -> None:
    """Run forward, backward and step on batches of noise."""
    from zoo.training.host_settings import keep_freed_memory

    if tuned:
        keep_freed_memory()
    images = [
        torch.randint(0, 255, (BATCH, 66, 200, 3), dtype=torch.uint8).permute(0, 3, 1, 2)
        for _ in range(4)
    ]
    if not tuned:
        images = [image.contiguous() for image in images]
    step = bare_step(pilotnet(tuned), fused=tuned)
    targets = torch.rand(BATCH, 1)

    feed = itertools.cycle({"images": image, "targets": targets} for image in images)
    answer(pipe, lambda: rate(step, feed, seconds))


def run_samples(pipe: Connection, seconds: float) -> None:
    """Run the usual loop of torch's tutorials."""
    from torch.utils.data import DataLoader

    from benchmarks.feed import SampleBySample, endless

    data = material.loaded_data(
        material.config_for(material.linked_recording(ROWS), material.AUGMENT, "model=nvidia")
    )
    # Without it the workers would be started as this process was, and import everything again.
    usual = {"multiprocessing_context": multiprocessing.get_all_start_methods()[0]}
    loader = DataLoader(SampleBySample(data), BATCH, shuffle=True, num_workers=WORKERS, **usual)
    step, feed = bare_step(pilotnet(tuned=False), fused=False), endless(loader)

    def run() -> float:
        # Uses up the batches that its workers prepared during other turns.
        rate(step, itertools.islice(feed, 2 * WORKERS), seconds)
        speed = rate(step, feed, seconds)
        time.sleep(2 * WORKERS * BATCH / speed)  # the workers prepare as much, in others' turns
        return speed

    answer(pipe, run)


def pilotnet(tuned: bool) -> torch.nn.Module:
    """Return the network of nvidia; unless `tuned`, with torch's own dropout."""
    from zoo.models import pilotnet

    if not tuned:
        pilotnet.Dropout = torch.nn.Dropout
    network = pilotnet.PilotNet((3, 66, 200))
    return network.to(memory_format=torch.channels_last) if tuned else network


def bare_step(
    network: torch.nn.Module, fused: bool
) -> Callable[[torch.Tensor, torch.Tensor], None]:
    """Return a training step of a network with mean squared error and Adam."""
    network.train()
    optimizer = torch.optim.Adam(network.parameters(), fused=fused)

    def step(images: torch.Tensor, targets: torch.Tensor) -> None:
        loss = torch.nn.functional.mse_loss(network(images), targets)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()

    return step


def rate(step: Callable, feed: Iterator[dict], seconds: float) -> float:
    """Return samples per second over a number of seconds, at least one batch."""
    began, count = time.perf_counter(), 0
    for batch in feed:
        step(**batch)
        count += BATCH
        if time.perf_counter() - began > seconds:
            break
    return count / (time.perf_counter() - began)


def answer(pipe: Connection, run: Callable[[], float]) -> None:
    """Serve `measuring.contestants`: run once to warm up, then once per request."""
    run()
    pipe.send(None)
    while pipe.recv():
        pipe.send(run())
    os._exit(0)  # a DataLoader takes up to 25 s to end its workers; they end without it


def best_product(device: str, side: int, dtype: torch.dtype) -> float:
    """Return the FLOP/s of the fastest product of two square matrices.

    On a CPU also the same product as a convolution of 1 x 1, which oneDNN computes: `torch.mm` uses
    MKL, which reaches half of that on AMD's processors.
    """
    left, right = (torch.randn(side, side, device=device, dtype=dtype) for _ in "ab")
    products: list[Callable[[], object]] = [lambda: torch.mm(left, right)]
    if device == "cpu":
        images = left.view(2, side // 16, 8, side).permute(0, 3, 1, 2)
        kernel = right.view(side, side, 1, 1)
        products.append(lambda: torch.conv2d(images, kernel))
    seconds = []
    with torch.no_grad():
        for product in [product for product in products for _ in range(TIMES)]:
            began = time.perf_counter()
            product()
            if device == "cuda":
                torch.cuda.synchronize()
            seconds.append(time.perf_counter() - began)
    return 2 * side**3 / min(seconds)


def run_product(pipe: Connection, device: str, side: int, dtype: torch.dtype) -> None:
    """Send the FLOP/s of the best product at each request."""
    answer(pipe, lambda: best_product(device, side, dtype))


def noise(network: torch.nn.Module, view: View, samples: int) -> Batch:
    """Return a batch of noise of a network's view, or of its windows."""
    window = facts_of(network).window
    frames = [window.sequence] if window and window.sequence > 1 else []
    images = torch.randint(0, 256, (samples, *frames, *view.shape), dtype=torch.uint8)
    return {"images": images.movedim(-1, -3), "speed": torch.full((samples,), 10.0)}


def untrained(name: str, samples: int) -> tuple[torch.nn.Module, dict[str, torch.Tensor]]:
    """Return a network with random weights, and a batch of noise."""
    torch.manual_seed(0)
    network, view, _ = material.random_network(name)
    return network, noise(network, view, samples)


def flops_of_sample(name: str) -> float:
    """Return the floating-point operations of a training step for each of its samples."""
    from zoo.training.batch_outputs import predictor  # imports torch, slowly

    network, batch = untrained(name, 2)
    with FlopCounterMode(display=False) as counter:
        predictor(network.train())(batch).square().mean().backward()
    return counter.get_total_flops() / 2

"""`trainer.precision=auto`: bfloat16 where this processor gains by it.

Networks that were trained in bfloat16 drive alike (docs/performance.md#bfloat16).
"""

import copy
import statistics
import time

import torch
from omegaconf import DictConfig
from rich.console import Console
from torch import nn

from datamodules.batches import Batch
from datamodules.view import View
from zoo.base.terminal import print_line
from zoo.cli.process_ranks import needs_processes
from zoo.training.host_settings import AUTO, FULL, HALF, keep_freed_memory, multiplies_bf16
from zoo.training.plan import TINY_PARAMETERS
from zoo.training.steering_module import predict

LEAST_GAIN = 1.15  # with less, the same weights on other processors are worth more
IMAGES, PAIRS = 32, 5  # of the measured steps
CLEAR = 3  # pairs that suffice if they agree
ENOUGH_S = 2.0  # after which no further pair is measured


def choose_precision(
    config: DictConfig, network: nn.Module, view: View, before: str | None, console: Console
) -> str:
    """Return `trainer.precision`, with a choice in place of `auto`; print what was measured.

    Args:
        config: experiment's config.
        network: network that is trained.
        view: what the network sees.
        before: precision of the checkpoint that a run resumes, which it keeps; None for a new run.
        console: console for that line.
    """
    asked = config.trainer.get("precision", FULL)
    if asked != AUTO:
        return asked
    if before in (FULL, HALF):  # a checkpoint may name anything
        return before
    on_cpu = config.trainer.accelerator == "cpu" or (
        config.trainer.accelerator == "auto" and not torch.cuda.is_available()
    )
    is_tiny = sum(p.numel() for p in network.parameters()) < TINY_PARAMETERS
    # Several processes might choose differently.
    if not on_cpu or is_tiny or needs_processes(config) or not multiplies_bf16():
        return FULL
    gain = gain_of_half(network, view)
    chosen = HALF if gain >= LEAST_GAIN else FULL
    print_line(
        console,
        f"trainer.precision=auto: {chosen}, since a step in bfloat16 is {gain:.2f} times as fast "
        "on this processor",
    )
    return chosen


def noise(network: nn.Module, view: View, samples: int) -> Batch:
    """Return a batch of noise of a network's view, or of its windows."""
    frames = [count] if (count := getattr(network, "sequence", 1)) > 1 else []
    images = torch.randint(0, 256, (samples, *frames, *view.shape), dtype=torch.uint8)
    return {"images": images.movedim(-1, -3), "speed": torch.full((samples,), 10.0)}


def gain_of_half(network: nn.Module, view: View) -> float:
    """Return the time of a step in 32 bits divided by that in bfloat16: the median over pairs.

    Neither weights nor random numbers change.
    """
    keep_freed_memory()  # as in training: page faults delay the larger numbers more
    network, gains = copy.deepcopy(network).train(), []
    started = time.perf_counter()
    with torch.random.fork_rng(devices=[]):
        batch = noise(network, view, max(1, IMAGES // getattr(network, "sequence", 1)))
        for turn in range(PAIRS + 1):
            is_clear = len(gains) >= CLEAR and len({one >= LEAST_GAIN for one in gains}) == 1
            if is_clear or (gains and time.perf_counter() - started > ENOUGH_S):
                break
            seconds = []
            for half in (False, True):
                began = time.perf_counter()
                with torch.autocast("cpu", torch.bfloat16, enabled=half):
                    loss = predict(network, batch).float().square().mean()
                loss.backward()
                seconds.append(time.perf_counter() - began)
            if turn:  # the first step of each prepares it
                gains.append(seconds[0] / seconds[1])
    return statistics.median(gains)

"""Measure the gain of bfloat16 by network: `python benchmarks/precision.py [lenet nvidia]`.

The rule of `zoo.training.precision` is drawn from its table.
"""

import statistics
import sys
import time

import torch

from benchmarks import material
from benchmarks.measuring import print_table
from benchmarks.training import noise
from zoo.base.conf_files import choice_files
from zoo.models.make_network import multiply_adds
from zoo.models.network_facts import facts_of
from zoo.training.batch_outputs import predictor
from zoo.training.host_settings import keep_freed_memory

IMAGES, PAIRS = 32, 9  # of the measured steps, which take turns


def gain_of_half(name: str) -> tuple[int, float]:
    """Return multiply-adds an image, and a step's seconds in 32 bits divided by bfloat16's."""
    torch.manual_seed(0)
    network, view, _ = material.random_network(name)
    (height, width, channels), window = view.shape, facts_of(network).window
    count = multiply_adds(network, (channels, height, width))
    batch = noise(network, view, max(1, IMAGES // (window.sequence if window else 1)))
    network.train().to(memory_format=torch.channels_last)
    predict, gains = predictor(network), []
    for _ in range(PAIRS + 1):
        seconds = []
        for half in (False, True):
            began = time.perf_counter()
            with torch.autocast("cpu", torch.bfloat16, enabled=half):
                loss = predict(batch).float().square().mean()
            loss.backward()
            seconds.append(time.perf_counter() - began)
        gains.append(seconds[0] / seconds[1])
    return count, statistics.median(gains[1:])  # the first step of each prepares it


def main(names: list[str]) -> None:
    """Print a row for each network."""
    keep_freed_memory()  # as in training
    choices = [name for name in sorted(choice_files("model")) if name != "keras"]
    rows = [(name, *gain_of_half(name)) for name in names or choices]
    rows.sort(key=lambda row: row[1])
    head = "network", "multiply-adds an image", "gain of bfloat16"
    print_table(head, [(name, f"{count:,}", f"{gain:.2f}") for name, count, gain in rows])


if __name__ == "__main__":
    main(sys.argv[1:])

"""The lines that a run prints before it trains."""

import torch
from rich.console import Console
from torch import nn

from datamodules.driving import DrivingData
from datamodules.leak import Leak
from datamodules.split import PARTS
from zoo.training.frozen_layers import random_front_lines


def print_start(
    card: dict,
    network: nn.Module,
    data: DrivingData,
    leaks: dict[str, Leak],
    device: torch.device,
    console: Console,
) -> None:
    """Print the network, the split, and train/validation similarity."""
    height, width, _ = data.view.shape
    model, parameters = card["config"]["model"], sum(p.numel() for p in network.parameters())
    split = ", ".join(f"{len(getattr(data.split, part)):,} {part}" for part in PARTS)
    for line in (
        f"{model['name']}: {parameters:,} parameters, sees {width} x {height} "
        f"{data.view.colour}, on {device}",
        f"split by {card['config']['data']['split']}: {split} rows; {len(data.samples):,} "
        "training samples",
        *_leak_lines(leaks),
        *random_front_lines(model["weights"], network),
    ):
        console.print(line, highlight=False, markup=False)


def _leak_lines(leaks: dict[str, Leak]) -> list[str]:
    return [
        f"leak: a {part} frame is {leak.seconds:.2f} s from the nearest training frame; it differs "
        f"from the most similar one {leak.likeness:.0%} as much as from any other (medians; near "
        "0 % they are copies, whose errors say little)"
        for part, leak in leaks.items()
    ]

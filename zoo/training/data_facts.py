"""What a training knows of its recording before it begins: for the card, and as printed lines."""

import numpy as np
import torch
from rich.console import Console
from torch import nn

from datamodules.looking.leak import Leak
from datamodules.recording import ROW_SAMPLE
from datamodules.recording_format import other_car
from datamodules.run_data import RunData
from datamodules.split import PARTS, rows_per_second
from zoo.base.rig import CURVATURE
from zoo.base.terminal import counted, print_line
from zoo.models.network_facts import facts_of
from zoo.training.recorded_roads import recorded_roads


def recorded_facts(data: RunData) -> dict:
    """Return the facts of a recording that a checkpoint's card holds."""
    recording = data.recording
    facts = {
        "fingerprint": recording.fingerprint(),
        "rows": len(recording),
        "rows_per_s": rows_per_second(recording),
        "speed_mph": float(np.median(recording.speed_mph)),
        "split_by": data.split_by,
        "row_hashes": recording.row_hashes()[:ROW_SAMPLE],
        "roads": recorded_roads(recording.names),
    }
    if not data.label.is_steering:
        facts[CURVATURE] = data.label.curvature_per_m
    if source := other_car(recording):
        facts |= {"source": source, "rig": recording.rig and recording.rig.name}
    return facts


def print_start(
    card: dict,
    network: nn.Module,
    data: RunData,
    leaks: dict[str, Leak],
    device: torch.device,
    console: Console,
) -> None:
    """Print the network, the split, and train/validation similarity."""
    (height, width, _), frame = data.view.shape, data.view.frame
    model, parameters = card["config"]["model"], sum(p.numel() for p in network.parameters())
    split = ", ".join(f"{len(getattr(data.split, part)):,} {part}" for part in PARTS)
    lines = [
        f"{model['name']}: {parameters:,} parameters, sees {width} x {height} "
        f"{data.view.colour} of frames of {frame[1]} x {frame[0]}, on {device}",
        f"split by {card['data']['split_by']}: {split} rows; "
        f"{counted(data.count_samples(), 'training sample')}",
    ]
    for part, leak in leaks.items():
        lines.append(
            f"leak: a {part} frame is {leak.seconds:.2f} s from the nearest training frame; it "
            f"differs from the most similar one {leak.likeness:.0%} as much as from any other "
            "(medians; near 0 % they are copies, whose errors say little)"
        )
    if model["weights"] is None and facts_of(network).frozen_front is not None:
        lines.append(
            "frozen blocks keep their random weights (model.weights=null): random features; "
            "a larger model.trainable_blocks trains them"
        )
    for line in lines:
        print_line(console, line)

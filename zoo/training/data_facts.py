"""What a training knows of its recording before it begins: for the card, and as printed lines."""

import numpy as np
import torch
from rich.console import Console
from torch import nn

from datamodules.looking.leak import seconds_apart
from datamodules.recorded_car import car_names, other_car
from datamodules.recording import ROW_SAMPLE
from datamodules.run_data import RunData
from datamodules.split import PARTS, rows_per_second
from zoo.base.rig import CURVATURE
from zoo.base.terminal import counted, print_line
from zoo.models.network_facts import facts_of
from zoo.training.recorded_roads import recorded_roads

NEAR_S = 1.0  # held-out rows this close to training rows are almost copies


def rows_apart(data: RunData) -> dict[str, float]:
    """Return the seconds from a part's rows to the nearest training row, see `seconds_apart`."""
    return {
        part: seconds_apart(data.recording, data.split.train, rows)
        for part in PARTS[1:]
        if len(rows := getattr(data.split, part)) and len(data.split.train)
    }


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
        rigs = car_names(rig.name if rig else None for rig in recording.each_rig)
        facts |= {"source": source, "rig": None if recording.without_rig else rigs}
    return facts


def print_start(
    card: dict,
    network: nn.Module,
    data: RunData,
    apart: dict[str, float],
    device: torch.device,
    console: Console,
) -> None:
    """Print the network and the split, and whether held-out rows are copies of training rows."""
    (height, width, _), frame = data.view.shape, data.view.frame
    model, parameters = card["config"]["model"], sum(p.numel() for p in network.parameters())
    split = ", ".join(f"{len(getattr(data.split, part)):,} {part}" for part in PARTS)
    lines = [
        f"{model['name']}: {parameters:,} parameters, sees {width} x {height} "
        f"{data.view.colour} of frames of {frame[1]} x {frame[0]}, on {device}",
        f"{split} rows ({card['data']['split_by']}); "
        f"{counted(data.count_samples(), 'training sample')}",
    ]
    if near := {part: seconds for part, seconds in apart.items() if seconds < NEAR_S}:
        lines.append(
            f"{' and '.join(near)} rows lie {max(near.values()):.2f} s from training rows: they "
            "are almost copies, and errors on them look too small; data.split=blocks keeps them "
            "apart in a longer recording"
        )
    if model.get("weights") is None and facts_of(network).frozen_front is not None:
        lines.append(
            "frozen blocks keep their random weights (model.weights=null): random features; "
            "a larger model.trainable_blocks trains them"
        )
    for line in lines:
        print_line(console, line)

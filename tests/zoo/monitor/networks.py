"""Small networks with convolutions and dropout, as checkpoints."""

from pathlib import Path

import torch

from datamodules.view import View
from tests.zoo.written_checkpoints import write_network
from zoo.models.make_network import make_network


def write_pilotnet(path: Path, seed: int = 0, dropout: float = 0.3) -> Path:
    """Write a checkpoint of a narrow PilotNet with random weights, and return its path."""
    model = {
        "_target_": "zoo.models.pilotnet.PilotNet",
        "name": "nvidia",
        "colour": "rgb",
        "size": [66, 200],
        "weights": None,
        "width": 0.1,
        "dropout": [dropout, dropout],
    }
    view = View([60, 20], "rgb", [66, 200])
    torch.manual_seed(seed)
    network = make_network(model, view)
    return write_network(path, network, view, {"model": model})

"""Small networks with convolutions and dropout, as checkpoints."""

from pathlib import Path

import torch

from datamodules.view import View
from zoo.checkpoints.checkpoint import make_card
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
    card = make_card({"model": model}, view, {"fingerprint": "0" * 16, "rows": 10})
    state = {f"network.{name}": one for name, one in network.state_dict().items()}
    path.parent.mkdir(parents=True, exist_ok=True)
    torch.save({"drivezoo": card, "state_dict": state}, path)
    return path

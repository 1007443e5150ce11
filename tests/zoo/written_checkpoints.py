"""Checkpoints of networks that were not trained."""

from pathlib import Path

import torch

from datamodules.view import View
from tests.zoo.models.test_models_command import build
from zoo.checkpoints.checkpoint import Checkpoint, make_card
from zoo.models.make_network import make_network


def checkpoint_of(name: str, *overrides: str, seed: int = 1) -> Checkpoint:
    """Return a checkpoint of a network of the zoo with random weights."""
    torch.manual_seed(seed)
    network, view = build(name, *overrides)
    return Checkpoint(network.eval(), view, {}, {"rows_per_s": 15.0})


def write_constant(path: Path, steering: float, epoch: int = 0, **config: object) -> Path:
    """Write a checkpoint of `model=linear` that always returns the same steering.

    Args:
        path: file to write.
        steering: steering that it returns, -1..1.
        epoch: epoch after which it was saved, from 0 on.
        config: sections of the card's config, in addition to `model`.
    """
    model = {"_target_": "zoo.models.linear.Linear", "name": "linear", "weights": None}
    model |= {"colour": "hsv_s", "size": [1, 14]}
    view = View([60, 40], "hsv_s", [1, 14])
    network = make_network(model, view)
    with torch.no_grad():
        network.head.weight.zero_()
        network.head.bias.fill_(steering)
    return write_network(path, network, view, {"model": model, **config}, epoch)


def write_network(
    path: Path, network: torch.nn.Module, view: View, config: dict, epoch: int = 0
) -> Path:
    """Write a checkpoint of a network, and return its path."""
    card = make_card(config, view, {"fingerprint": "0" * 16, "rows": 10})
    state = {f"network.{name}": tensor for name, tensor in network.state_dict().items()}
    path.parent.mkdir(parents=True, exist_ok=True)
    torch.save({"drivezoo": card, "state_dict": state, "epoch": epoch}, path)
    return path


def write_pilotnet(path: Path, seed: int = 0, dropout: float = 0.3) -> Path:
    """Write a checkpoint of a narrow PilotNet with random weights, and return its path."""
    model = {"_target_": "zoo.models.pilotnet.PilotNet", "name": "nvidia", "weights": None}
    model |= {"colour": "rgb", "size": [66, 200], "width": 0.1, "dropout": [dropout, dropout]}
    view = View([60, 20], "rgb", [66, 200])
    torch.manual_seed(seed)
    return write_network(path, make_network(model, view), view, {"model": model})

"""A straight road, and a checkpoint that drives straight in daylight and turns off in the dark."""

from pathlib import Path

import torch
import yaml

from datamodules.view import View
from simulator.track_names import road_folder
from simulator.world import open_world
from tests.zoo.written_checkpoints import write_network
from zoo.models.make_network import make_network

GAIN = 0.12  # steering to the right for each unit by which the mean grey level, -1..1, falls


def write_road(folder: Path) -> str:
    """Write a family of straight open roads of 120 m, and return the name of one."""
    family = yaml.safe_load((road_folder() / "lakeside.yaml").read_text())
    road = folder / "straight.yaml"
    changes = {"length": [120, 120], "closed": 0, "radius": [900, 900], "grade": [0, 0]}
    road.write_text(yaml.safe_dump(family | changes))
    return f"{road}:1"


def write_daylight(path: Path, track: str) -> Path:
    """Write a checkpoint that steers by the darkness of the frame, and return its path."""
    model = {
        "_target_": "zoo.models.linear.Linear",
        "name": "linear",
        "colour": "gray",
        "size": [4, 14],
        "weights": None,
    }
    view = View([60, 20], "gray", [4, 14])
    network = make_network(model, view)
    world = open_world(track, renderer="auto", quality="simple")
    world.reset(0)
    image = torch.from_numpy(view(world.frame())[None]).permute(0, 3, 1, 2)
    world.renderer.close()
    with torch.no_grad():
        network.head.weight.fill_(-GAIN / network.head.weight.numel())
        network.head.bias.zero_().sub_(network(image)[0])
    return write_network(path, network, view, {"model": model})

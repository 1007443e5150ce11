"""`python -m zoo.models`: the zoo as a table."""

import inspect
import sys

import torch
from rich.console import Console
from rich.table import Table
from torch.utils.flop_counter import FlopCounterMode

from datamodules.view import View
from zoo.checkpoint import VIEW_KEYS, make_network
from zoo.config import choices, compose_config


def multiply_adds(network: torch.nn.Module, shape: tuple[int, int, int]) -> int:
    """Multiply-adds of one forward pass of convolutions and dense layers."""
    images, speed = torch.zeros(1, *shape), torch.zeros(1)
    network.eval()
    with torch.no_grad(), FlopCounterMode(display=False) as counter:
        network(images, speed) if network.takes_speed else network(images)
    return counter.get_total_flops() // 2


def paper(network: torch.nn.Module) -> str:
    """The first line of the network's module, which names its source."""
    return inspect.getdoc(sys.modules[type(network).__module__]).splitlines()[0].rstrip(".")


def zoo_table() -> tuple[Table, dict[str, str]]:
    """Each model of `conf/model` with its own view, and the source of each."""
    sources = {}
    table = Table(title="the zoo", title_justify="left")
    for column in ("model", "input (CxHxW)", "colour", "parameters", "multiply-adds"):
        table.add_column(column, justify="right" if column[-1] == "s" else "left")
    for name in choices("model"):
        config = compose_config([f"model={name}"])
        # comma.ai's network has no size of its own: it is published for the whole picture.
        crop = config["data"]["crop"] if config["model"]["size"] else [0, 0]
        view = View(crop, **{key: config["model"][key] for key in VIEW_KEYS})
        network = make_network(config["model"], view)
        height, width, channels = view.shape
        parameters = sum(parameter.numel() for parameter in network.parameters())
        table.add_row(
            name,
            f"{channels} x {height} x {width}",
            view.colour,
            f"{parameters:,}",
            f"{multiply_adds(network, (channels, height, width)):,}",
        )
        sources[name] = paper(network)
    return table, sources


if __name__ == "__main__":
    table, sources = zoo_table()
    console = Console(soft_wrap=True)
    console.print(table)
    for name, source in sources.items():
        console.print(f"{name}: {source}", highlight=False)

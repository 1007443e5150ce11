"""The section on the network: layer by layer, with shapes and parameters."""

import re
from dataclasses import dataclass

import torch
from torch import nn

from zoo.checkpoints.checkpoint import Checkpoint
from zoo.report.blocks import Block, Rows, Text, gather
from zoo.report.reported_run import Run


@dataclass(frozen=True)
class Layer:
    """A layer as it was called.

    Attributes:
        name: within the network; empty for what belongs to no layer.
        kind: its class, and how it was made.
        shape: what came out, without the batch.
        parameters: its own.
    """

    name: str
    kind: str
    shape: tuple[int, ...]
    parameters: int


def network_layers(network: nn.Module, shape: tuple[int, int, int]) -> list[Layer]:
    """The layers in the order of a forward pass over a view of `(height, width, channels)`.

    The parameters add up to the network's: one that is used twice counts once, one that no layer
    owns gets a line of its own.
    """
    layers: list[Layer] = []
    counted: set[int] = set()
    names = {module: name for name, module in network.named_modules()}

    def note(module: nn.Module, _: object, output: torch.Tensor) -> None:
        own = [p for p in module.parameters() if id(p) not in counted]
        counted.update(map(id, own))
        kind = f"{type(module).__name__} ({_details(module)})".removesuffix(" ()")
        size = sum(p.numel() for p in own)
        layers.append(Layer(names[module], kind, tuple(output.shape[1:]), size))

    leaves = [module for module in network.modules() if not list(module.children())]
    hooks = [leaf.register_forward_hook(note) for leaf in leaves]
    height, width, channels = shape
    inputs = [torch.zeros(1, channels, height, width)]
    try:
        with torch.inference_mode():
            network.eval()(*inputs, *([torch.zeros(1)] if network.takes_speed else []))
    finally:
        for hook in hooks:
            hook.remove()
    rest = [p for p in network.parameters() if id(p) not in counted]
    if rest:
        layers.append(Layer("", "parameters of no layer", (), sum(p.numel() for p in rest)))
    return layers


def network_blocks(run: Run) -> list[Block]:
    """What the network is, and its table."""
    return gather((_table,), run)


def _table(run: Run) -> list[Block]:
    from zoo.models.network_facts import multiply_adds, paper

    checkpoint: Checkpoint = run.checkpoint
    network, view = checkpoint.network, checkpoint.view
    layers = network_layers(network, view.shape)
    height, width, channels = view.shape
    total = sum(layer.parameters for layer in layers)
    trained = sum(p.numel() for p in network.parameters() if p.requires_grad)
    rows = [
        [layer.name, layer.kind, _size(layer.shape), f"{layer.parameters:,}"] for layer in layers
    ]
    rows.append(["in all", "", "", f"{total:,}"])
    takes = "It takes the speed beside the picture. " if network.takes_speed else ""
    gives = "steering and throttle" if network.outputs == 2 else "the steering"
    frozen = "" if trained == total else f" ({total - trained:,} of them frozen)"
    top, bottom = view.crop
    return [
        Text(
            f"{run.config['model']['name']}: {paper(network)}. {takes}It gives {gives}: "
            f"{total:,} parameters{frozen}, "
            f"{multiply_adds(network, (channels, height, width)):,} multiply-adds for a frame."
        ),
        Text(
            f"The view: of 160 x 320 pixels, {top} rows at the top and {bottom} at the bottom are "
            f"cropped, the colour is {view.colour}, the size {height} x {width}. It is stored in "
            "the checkpoint, and whoever drives uses the same. Pixels are scaled in the network."
        ),
        Rows(
            ["layer", "kind", "output", "parameters"],
            rows,
            left=2,
            bold=frozenset({len(rows) - 1}),
        ),
    ]


def _details(module: nn.Module) -> str:
    """How PyTorch describes it, without what goes without saying."""
    said = re.sub(r"\d+\.\d{4,}", lambda found: f"{float(found[0]):.3g}", module.extra_repr())
    return said.replace(", inplace=False", "").replace(", bias=True", "")


def _size(shape: tuple[int, ...]) -> str:
    return " x ".join(map(str, shape))

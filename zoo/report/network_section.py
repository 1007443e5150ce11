"""The section on the network: its layers with output shapes and parameters."""

import re
from dataclasses import dataclass

import torch
from torch import nn

from zoo.checkpoints.checkpoint import Checkpoint
from zoo.models.memory import Memory, frame_outputs
from zoo.report.blocks import Block, Rows, Text
from zoo.report.reported_run import ReportedRun
from zoo.runs.table import Table


@dataclass(frozen=True)
class Layer:
    """A call of a layer.

    Attributes:
        name: name in the network; empty for parameters outside layers.
        kind: class and settings.
        shape: shape of the output, without the batch.
        parameters: number of parameters that no earlier call has counted.
    """

    name: str
    kind: str
    shape: tuple[int, ...]
    parameters: int


def network_layers(network: nn.Module, shape: tuple[int, int, int]) -> list[Layer]:
    """Return the layers in the order of a forward pass.

    The parameters add up to the network's: a layer that is used twice counts once, and parameters
    outside layers get their own entry.

    Args:
        network: network of the zoo.
        shape: `(height, width, channels)` of the view.
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
    try:
        with torch.inference_mode():
            images = torch.zeros(1, channels, height, width)
            frame_outputs(network.eval(), images, torch.zeros(1))
    finally:
        for hook in hooks:
            hook.remove()
    rest = [p for p in network.parameters() if id(p) not in counted]
    if rest:
        layers.append(Layer("", "parameters outside layers", (), sum(p.numel() for p in rest)))
    return layers


def layers_table(run: ReportedRun) -> list[Block]:
    """Return a summary of the network and the table of its layers."""
    from zoo.models.make_network import multiply_adds, paper

    checkpoint: Checkpoint = run.checkpoint
    network, view = checkpoint.network, checkpoint.view
    layers = network_layers(network, view.shape)
    height, width, channels = view.shape
    total = sum(layer.parameters for layer in layers)
    trained = sum(p.numel() for p in network.parameters() if p.requires_grad)
    rows = [
        [layer.name, layer.kind, " x ".join(map(str, layer.shape)), f"{layer.parameters:,}"]
        for layer in layers
    ]
    rows.append(["total", "", "", f"{total:,}"])
    inputs = "image and speed" if network.takes_speed else "image"
    outputs = "steering and throttle" if network.outputs == 2 else "steering"
    outputs += " with its spread" if getattr(network, "predicts_spread", False) else ""
    window = f" It was trained on {network.window}." if isinstance(network, Memory) else ""
    return [
        Text(
            f"{run.config['model']['name']}: {paper(network)}. Input: {inputs}. Output: {outputs}."
            f"{window} {total:,} parameters ({trained:,} of them trained), "
            f"{multiply_adds(network, (channels, height, width)):,} multiply-adds per frame."
        ),
        Text(
            f"The view crops {view.crop_text}. Its colour is {view.colour}, its size {height} x "
            f"{width} (resize: {view.resize}). The checkpoint stores the view, so driving uses "
            "the same. The network itself scales the pixels."
        ),
        Rows(
            Table.of(["layer", "type", "output", "parameters"], rows),
            left=2,
            bold=frozenset({len(rows) - 1}),
        ),
    ]


def _details(module: nn.Module) -> str:
    """Return PyTorch's text on a layer's settings, without common defaults."""
    text = re.sub(r"\d+\.\d{4,}", lambda found: f"{float(found[0]):.3g}", module.extra_repr())
    return text.replace(", inplace=False", "").replace(", bias=True", "")

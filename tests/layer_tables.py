"""The tables of layers of `docs/models`, as the code has them.

A network's page has a line `<!-- layers of NAME -->` where its table belongs, and
`docs/models/index.md` a line `<!-- networks -->`; each table ends at its closing marker.
"""

import re
from pathlib import Path

from torch import nn

from benchmarks.measuring import markdown_table
from zoo.base.compose import compose_config
from zoo.models.efficientnet_lite0 import InvertedResidual
from zoo.models.layers import SCALE, LogSpread, Normalize, SameConv2d
from zoo.models.make_network import make_network, multiply_adds, published_view
from zoo.models.ncp import CfcCell
from zoo.models.vgg import ImageNetNormalize
from zoo.scoring.training_section import Layer, network_layers

PAGES = Path("docs/models")
NORM = "batch normalization"


class NetworkFacts:
    """What the pages print of a network of `conf/model`, with the settings of its YAML.

    Args:
        name: as `model=` takes it.

    Attributes:
        view: published view.
        size: the view's `channels x height x width`.
        layers: descriptions in the order of a forward pass, with output shape and parameters.
        parameters: number of parameters of all layers.
        multiply_adds: of one forward pass.
    """

    def __init__(self, name: str) -> None:
        config = compose_config([f"model={name}"])
        self.name, self.view = name, published_view(config)
        height, width, channels = self.view.shape
        network = make_network(config["model"], self.view)
        self.size = _size((channels, height, width))
        self.layers = _folded(network, network_layers(network, self.view.shape))
        self.parameters = sum(count for *_, count in self.layers)
        self.multiply_adds = multiply_adds(network, (channels, height, width))


def _folded(network: nn.Module, layers: list[Layer]) -> list[tuple[str, tuple[int, ...], int]]:
    """Return a line for each layer with parameters or another shape, activations added to it.

    An inverted residual is one line; a batch normalization stands in its convolution's.
    """
    modules = dict(network.named_modules())
    blocks = [name for name, module in modules.items() if isinstance(module, InvertedResidual)]
    lines: list[tuple[str, tuple[int, ...], int]] = []
    block = None
    for layer in layers:
        words = layer_words(modules[layer.name]) if layer.name else layer.kind
        if words in ("dropout 0", "Identity"):
            continue
        before, block = block, next((b for b in blocks if layer.name.startswith(f"{b}.")), None)
        folds = lines and layer.shape == lines[-1][1] and (not layer.parameters or words == NORM)
        if block is not None and block != before:
            lines.append((layer_words(modules[block]), layer.shape, layer.parameters))
        elif block is not None or folds:
            first, shape, count = lines[-1]
            first, shape = (first, layer.shape) if block else (f"{first}; {words}", shape)
            lines[-1] = (first, shape, count + layer.parameters)
        else:
            lines.append((words, layer.shape, layer.parameters))
    return lines


def layer_words(module: nn.Module) -> str:
    """Return a layer in words.

    >>> layer_words(nn.Conv2d(3, 24, 5, 2)), layer_words(nn.Dropout(0.5))
    ('convolution, 24 of 5 x 5, stride 2', 'dropout 0.5')
    """
    match module:
        case CfcCell():
            count = module.out_features // 3
            return f"{count} sparse continuous-time neuron{'s' * (count > 1)}"
        case nn.Conv1d() | nn.Conv2d():
            kernel = " x ".join(map(str, module.kernel_size))
            kernel = f"length {kernel}" if isinstance(module, nn.Conv1d) else kernel
            stride = f", stride {module.stride[0]}" if module.stride[0] > 1 else ""
            same = ", same size" if any(module.padding) else ""
            if isinstance(module, SameConv2d):
                same = ", padded as TensorFlow's same"
            groups = f", in {module.groups} groups" if module.groups > 1 else ""
            return f"convolution, {module.out_channels} of {kernel}{stride}{same}{groups}"
        case InvertedResidual():
            inner = layer_words(module.depthwise.conv).partition(" of ")[2]
            inner = inner.partition(", in ")[0]
            added = "; input added" if module.adds_input else ""
            return f"inverted residual, {module.depthwise.conv.out_channels} of {inner}{added}"
        case nn.BatchNorm2d():
            return NORM
        case nn.Linear():
            return f"dense, {module.out_features}"
        case nn.MaxPool1d() | nn.MaxPool2d():
            dimensions = 1 if isinstance(module, nn.MaxPool1d) else 2
            return f"max pooling, {' x '.join([str(module.kernel_size)] * dimensions)}"
        case nn.Dropout():
            return f"dropout {module.p:.2g}"
        case Normalize():
            to_ones = (module.divisor, module.shift) == SCALE
            return "scale to -1..1" if to_ones else module.extra_repr()
        case ImageNetNormalize():
            return "ImageNet's mean 0, deviation 1"
        case LogSpread():
            return "last column to -5..1"
        case nn.Flatten():
            return "rows as channels"
    return type(module).__name__


def layer_table(facts: NetworkFacts) -> str:
    """Return the network's line of facts and its table of layers."""
    rows = [[words, _size(shape), f"{count:,}"] for words, shape, count in facts.layers]
    rows.insert(0, [f"input, {facts.view.colour}", facts.size, ""])
    rows.append(["**total**", "", f"**{facts.parameters:,}**"])
    return markdown_table(["layer", "output", "parameters"], rows)


def networks_table(networks: list[NetworkFacts], pages: dict[str, Path]) -> str:
    """Return a line for each network, with a link to its page."""
    rows = []
    for network in networks:
        link = f"[`{network.name}`]({pages[network.name].name})"
        figures = f"{network.parameters:,}", f"{network.multiply_adds:,}"
        rows.append([link, network.size, network.view.colour, *figures])
    head = ["model", "input (C x H x W)", "colour", "parameters", "multiply-adds"]
    return markdown_table(head, rows, left=3)


def layers_mark(name: str) -> str:
    """Return the line above a network's table."""
    return f"<!-- layers of {name} -->"


def pages_by_network(folder: Path = PAGES) -> dict[str, Path]:
    """Return the page of each network that has one, in alphabetical order of networks."""
    texts = {page: page.read_text() for page in folder.glob("*.md")}
    mark = re.compile(layers_mark(r"(\S+)"))
    pages = {name: page for page, text in texts.items() for name in mark.findall(text)}
    return dict(sorted(pages.items()))


def _size(shape: tuple[int, ...]) -> str:
    return " x ".join(map(str, shape))

"""A chain of Keras' layers, built from plain specs."""

import math
from collections.abc import Mapping, Sequence

from torch import Tensor, nn

from zoo.extras.keras.layer_spec import LayerSpec, Shape
from zoo.extras.keras.spec_builders import BUILDERS
from zoo.models.layers import SCALE, Normalize
from zoo.models.network_facts import NetworkFacts

MOST_LAYERS = 1000
MOST_VALUES = 2**26  # of a layer's output for one image
MOST_WORK = 200_000_000_000  # multiply-adds for one image; VGG16's has 15 billion
# Without layers it is a linear regression: the smallest network that steers.
DEFAULT_LAYERS = ({"layer": "Flatten"}, {"layer": "Dense", "units": 1})
FIRST = "channels_first"


class LayerChain(nn.Module):
    """A network from plain specs of layers; the values are those of Keras.

    Args:
        shape: `(channels, height, width)` of the view.
        layers: specs of the layers in order: `layer`, a class of Keras, and its settings with the
            names and values of Keras 2. None for one dense layer.
        scale: the network computes `pixel / scale[0] - scale[1]` first; None for -1..1.

    Raises:
        ValueError: a spec is wrong; names the layer, the setting and the value.
    """

    def __init__(
        self,
        shape: tuple[int, int, int],
        layers: Sequence[Mapping] | None = None,
        scale: Sequence[float] | None = None,
    ) -> None:
        super().__init__()
        specs = check_specs(layers if layers is not None else DEFAULT_LAYERS)
        first = is_channels_first(specs)
        channels, height, width = shape
        self.scale: Sequence[float] = SCALE if scale is None else tuple(scale)
        self.normalize = Normalize(self.scale)
        modules, shapes = build_layers(specs, shape if first else (height, width, channels), first)
        self.layers = nn.Sequential(*modules)
        outputs = math.prod(shapes[-1])
        if outputs not in (1, 2):
            raise ValueError(
                f"model.layers: the last layer has {outputs} outputs; a network steers with "
                "1 or 2, steering and throttle"
            )
        self.facts = NetworkFacts(outputs)

    def forward(self, images: Tensor) -> Tensor:
        """Return the steering, and the throttle with two outputs; [N, outputs]."""
        return self.layers(self.normalize(images)).flatten(1)


def check_specs(layers: object) -> list[Mapping]:
    """Return the specs, checked to be a list of mappings that name known layers."""
    if not isinstance(layers, list | tuple) or not 0 < len(layers) <= MOST_LAYERS:
        raise ValueError(f"model.layers is not a list of 1 to {MOST_LAYERS} layers")
    for number, entry in enumerate(layers, start=1):
        name = entry.get("layer") if isinstance(entry, Mapping) else None
        if not isinstance(name, str) or name not in BUILDERS:
            names = ", ".join(BUILDERS)
            raise ValueError(
                f"model.layers: layer {number} is {name!r:.40}, no known layer; known are {names}"
            )
    return list(layers)


def is_channels_first(specs: Sequence[Mapping]) -> bool:
    """Return whether the layers were trained with images [N, C, H, W]."""
    return any(spec.get("data_format") == FIRST for spec in specs if spec["layer"] != "Flatten")


def build_layers(
    specs: Sequence[Mapping], shape: Shape, first: bool, labels: Sequence[str] | None = None
) -> tuple[list[nn.Module], list[Shape]]:
    """Return a module and an output shape, in Keras' order of axes, for each spec.

    Args:
        specs: checked specs.
        shape: shape of an image in Keras' order of axes.
        first: whether that order is channels first.
        labels: text on each layer for messages; None for their positions.

    Raises:
        ValueError: a spec is wrong, or a layer does not fit the output of the layer before.
    """
    modules, shapes, work = [], [], 0
    for number, values in enumerate(specs, start=1):
        label = f"model.layers: layer {number} of {len(specs)} ({values['layer']})"
        spec = LayerSpec(values, labels[number - 1] if labels else label)
        module, shape = BUILDERS[values["layer"]](spec, shape, first)
        spec.check_all_read()
        places = math.prod(shape[1:] if first else shape[:-1])
        work += places * sum(parameter.numel() for parameter in module.parameters())
        empty = min(shape, default=1) < 1
        if empty or math.prod(shape) > MOST_VALUES or work > MOST_WORK:
            raise ValueError(
                f"{spec.label}: its output would be {' x '.join(map(str, shape))}, which is "
                f"{'empty' if empty else 'too large'}; set the view of the training (data.crop, "
                "model.size), or other layers"
            )
        modules.append(module)
        shapes.append(shape)
    return modules, shapes

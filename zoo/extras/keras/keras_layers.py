"""Convert a Keras model to specs and weights of `zoo.extras.keras.sequential.Sequential`."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from zoo.base.errors import InputError
from zoo.extras.keras.keras_chain import Chain, Scale
from zoo.extras.keras.keras_lambda import WORDS
from zoo.extras.keras.keras_model import THROTTLE_RANGE, KerasModel
from zoo.extras.keras.keras_specs import Spec, plain_kind
from zoo.extras.keras.keras_weights import MisfitError, copy_arrays
from zoo.extras.keras.layer_chain import LayerChain, build_layers, is_channels_first
from zoo.extras.keras.layer_spec import by
from zoo.models.make_network import LimitedParameters

SIDES = set(range(1, 4097))  # of an image, in pixels


@dataclass(frozen=True)
class LayerNote:
    """What was understood of a layer, for a person.

    Attributes:
        position: its position in the file, from 1.
        name: its name in the file.
        kind: its class in the file.
        understood: what it does in the converted network.
        shape: its output's shape in Keras' order of axes.
        parameters: number of its weights.
    """

    position: int
    name: str
    kind: str
    understood: str
    shape: tuple[int, ...]
    parameters: int


@dataclass(frozen=True)
class ConvertedKeras:
    """A Keras model as a network of drivezoo.

    Attributes:
        layers: specs for `model.layers`.
        network: network of these layers, with the file's weights.
        input_shape: `(height, width, channels)` of the images.
        scale: the network computes `pixel / scale[0] - scale[1]`; None if the file does not tell.
        notes: what was understood, layer by layer.
    """

    layers: list[Spec]
    network: LayerChain
    input_shape: tuple[int, int, int]
    scale: Scale | None
    notes: list[LayerNote]

    @property
    def state(self) -> dict[str, Tensor]:
        """Return the state dict of `Sequential`."""
        return self.network.state_dict()


def convert(
    model: KerasModel,
    scale: Sequence[float] | None = None,
    lambdas: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
    size: Sequence[int] | None = None,
    throttle_range: float = THROTTLE_RANGE,
    line: Sequence[float] | None = None,
) -> ConvertedKeras:
    """Return a Keras model's layers and weights for `Sequential`.

    Args:
        model: model that `read_keras` returned.
        scale: divisor and subtracted number, in place of what the file tells; an unclear Lambda
            before the first weights is this scale.
        lambdas: a word for each unclear Lambda in order; see `keras_lambda.WORDS`.
        outputs: name of each output, `steering`, `throttle` or `ignored`, if there are several.
        size: rows and columns of the images, if the file does not have them.
        throttle_range: throttle at the end of Donkeycar's bins.
        line: factor and offset that change the output to the steering; None if it is the steering.

    Raises:
        InputError: a layer is unknown or unclear, or does not fit the one before; names its
            position, its name and the remedy.
    """
    if not model.has_architecture:
        raise InputError(
            f"{model.path}: holds weights without the architecture; name the model's .json file"
        )
    chain = Chain(model, scale, lambdas)
    specs, owners = chain.specs, chain.owners
    labels = [chain.label(owner) for owner in owners]
    first = is_channels_first(specs)
    shape = _input_shape(model, first, size)
    try:
        with LimitedParameters():
            modules, shapes = build_layers(specs, shape, first, labels)
    except ValueError as error:
        raise InputError(f"{model.path}: {error}") from None
    for owner in sorted(set(owners)):
        parts = [modules[index] for index, other in enumerate(owners) if other == owner]
        layer = model.layers[owner]
        layer = replace(layer, arrays=[]) if layer.kind == "Normalization" else layer
        try:
            copy_arrays(layer, torch.nn.Sequential(*parts), model, first)
        except MisfitError as error:
            fix = "the file is damaged or of another model: save the model again"
            if error.follows_input:
                size_text = by(shape[1:] if first else shape[:2])
                fix = f'the images of its training were not {size_text}: set "size=[rows,columns]"'
            if error.follows_input and chain.assumed:
                fix = (
                    "an unclear Lambda was taken as the scale, and may do more: set "
                    f'"lambdas=[WORD]" for {chain.assumed.rpartition(": ")[2]}, with one of {WORDS}'
                )
            raise InputError(f"{model.path}: {chain.label(owner)}: {error}; {fix}") from None
    notes = _notes(model, chain, shapes, shape)
    last = shapes[-1] if shapes else shape
    specs = [*specs, *(_bins(model, throttle_range) or _output_specs(model, last, outputs))]
    channels, rows, columns = shape if first else (shape[2], *shape[:2])
    network = LayerChain((channels, rows, columns), specs, chain.scale)
    for index, module in enumerate(modules):
        network.layers[index] = module
    if line is not None:
        specs.append({"layer": "Dense", "units": network.facts.outputs})
        network.layers.append(_line_layer(network.facts.outputs, *line))
    return ConvertedKeras(specs, network, (rows, columns, channels), chain.scale, notes)


def _line_layer(outputs: int, factor: float, offset: float) -> torch.nn.Linear:
    """Return a layer that computes `factor x steering + offset`, and keeps a throttle.

    A dense layer of its own, which all exports know, also after an activation.
    """
    layer = torch.nn.Linear(outputs, outputs)
    with torch.no_grad():
        layer.weight.copy_(torch.eye(outputs))
        layer.weight[0, 0] = factor
        layer.bias.zero_()
        layer.bias[0] = offset
    return layer


def _notes(
    model: KerasModel, chain: Chain, shapes: list[tuple[int, ...]], shape: tuple[int, ...]
) -> list[LayerNote]:
    notes = []
    for index, (layer, understood) in enumerate(zip(model.layers, chain.understood, strict=True)):
        sizes = [size for size, owner in zip(shapes, chain.owners, strict=True) if owner == index]
        shape = sizes[-1] if sizes else shape
        count = sum(array.size for array in layer.arrays)
        notes.append(LayerNote(index + 1, layer.name, layer.kind, understood, shape, count))
    return notes


def _input_shape(
    model: KerasModel, first: bool, size: Sequence[int] | None
) -> tuple[int, int, int]:
    """Return the shape of an image in Keras' order of axes.

    Raises:
        InputError: the file does not have it and `size` is None, or it is not an image's.
    """
    saved = model.input_shape or [None, None, None]
    if len(saved) != 3:
        raise InputError(
            f"{model.path}: its input is {by(saved):.100}, not an image of rows, columns and "
            "channels; only networks of one image are converted"
        )
    channels, rows, columns = saved if first else (saved[2], *saved[:2])
    if channels is None:
        channels = _kernel_channels(model)
    if size is not None and None in (rows, columns):
        rows, columns = size
    if None in (rows, columns) or type(channels) is not int:
        raise InputError(
            f'{model.path}: has no size of its input; set "size=[rows,columns]" of the images in '
            'its training, such as "size=[66,200]"'
        )
    if channels not in (1, 3):
        raise InputError(
            f"{model.path}: its input has {channels!s:.20} channels; only images of 1 or 3 "
            "are converted"
        )
    if type(rows) is not int or type(columns) is not int or not {rows, columns} <= SIDES:
        raise InputError(
            f"{model.path}: its input of {rows!s:.20} x {columns!s:.20} is not 1 to 4096 pixels"
        )
    return (channels, rows, columns) if first else (rows, columns, channels)


def _kernel_channels(model: KerasModel) -> int | None:
    layer = next((layer for layer in model.layers if layer.arrays), None)
    if layer is None or not plain_kind(layer.kind).endswith("Conv2D") or layer.arrays[0].ndim != 4:
        return None
    return int(layer.arrays[0].shape[2])


def _bins(model: KerasModel, throttle_range: float) -> list[Spec]:
    """Return the spec that reads Donkeycar's bins of angle and throttle; none without bins.

    Source: `linear_unbin` in donkeycar/utils.py, as `KerasCategorical` calls it.
    """
    bins = list(model.outputs.values())
    if not model.is_donkeycar or bins in ([], [1, 1]):
        return []
    steps = [2 / (15 - 1), throttle_range / bins[1]]
    return [{"layer": "Unbin", "bins": bins, "lows": [-1.0, 0.0], "steps": steps}]


def _output_specs(
    model: KerasModel, shape: tuple[int, ...], outputs: Sequence[str] | None
) -> list[Spec]:
    """Return the specs that bring the outputs into the order steering, throttle."""
    count = math.prod(shape)
    flat: list[Spec] = [] if len(shape) == 1 else [{"layer": "Flatten"}]
    if count == 1:
        return flat
    if count > 4 and outputs is None:
        raise InputError(
            f"{model.path}: has {count} outputs, so it is a network of another task; name one that "
            "returns the steering"
        )
    names = list(outputs or (("steering", "throttle") if model.is_donkeycar else ()))
    roles = ("steering", "throttle", "ignored")
    if len(names) != count or names.count("steering") != 1 or names.count("throttle") > 1:
        raise InputError(
            f'{model.path}: has {count} outputs; name each, drivezoo import FILE "outputs=['
            f'{",".join((*roles[:2], *["ignored"] * count)[:count])}]", steering once'
        )
    if set(names) - set(roles):
        raise InputError(f"{model.path}: outputs={names!s:.100}: known are {', '.join(roles)}")
    columns = [names.index(role) for role in roles[:2] if role in names]
    if columns == list(range(count)):
        return flat
    return [*flat, {"layer": "Select", "columns": columns}]

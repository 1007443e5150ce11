"""Convert a Keras model to specs and weights of `zoo.models.sequential.Sequential`."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from datamodules.errors import InputError
from zoo.checkpoints.keras_file import KerasLayer, KerasModel
from zoo.checkpoints.keras_lambda import WORDS, describe_lambda, specs_of_word
from zoo.checkpoints.keras_specs import (
    CLASSES,
    RECURRENT,
    Spec,
    UnknownValueError,
    operator_specs,
    specs_of,
)
from zoo.checkpoints.keras_tensors import MisfitError, by, copy_arrays
from zoo.models.make_network import LimitedParameters
from zoo.models.sequential import Sequential, build_layers, is_channels_first

Scale = tuple[float, float]
# A scale before these layers is the same as one at the network's input.
BEFORE_SCALE = ("Cropping2D", "Resize")


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
        state: state dict of `Sequential`.
        input_shape: `(height, width, channels)` of the images.
        scale: the network computes `pixel / scale[0] - scale[1]`; None if the file does not tell.
        notes: what was understood, layer by layer.
        outputs: number of the outputs: steering, or steering and throttle.
    """

    layers: list[Spec]
    state: dict[str, Tensor]
    input_shape: tuple[int, int, int]
    scale: Scale | None
    notes: list[LayerNote]
    outputs: int


def convert(
    model: KerasModel,
    scale: Sequence[float] | None = None,
    lambdas: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
    size: Sequence[int] | None = None,
) -> ConvertedKeras:
    """Return a Keras model's layers and weights for `Sequential`.

    Args:
        model: model that `read_keras` returned.
        scale: divisor and subtracted number, in place of what the file tells; an unclear Lambda
            before the first weights is this scale.
        lambdas: a word for each unclear Lambda in order; see `keras_lambda.WORDS`.
        outputs: name of each output, `steering`, `throttle` or `ignored`, if there are several.
        size: rows and columns of the images, if the file does not have them.

    Raises:
        InputError: a layer is unknown or unclear, or does not fit the one before; names its
            position, its name and the remedy.
    """
    if not model.has_architecture:
        raise InputError(
            f"{model.path}: holds weights without the architecture; name the model's .json file"
        )
    chain = _Chain(model, scale, lambdas)
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
        own = [modules[index] for index, one in enumerate(owners) if one == owner]
        try:
            copy_arrays(model.layers[owner], torch.nn.Sequential(*own), model, first)
        except MisfitError as error:
            raise InputError(
                f"{model.path}: {chain.label(owner)}: {error}{_remedy(error, shape, first)}"
            ) from None
    notes = _notes(model, chain, shapes, shape)
    chosen = _output_specs(model, shapes[-1] if shapes else shape, outputs)
    specs = [*specs, *chosen]
    rows = shape[1:] if first else shape[:2]
    channels = shape[0] if first else shape[2]
    network = Sequential((channels, *rows), specs, chain.scale)
    for index, module in enumerate(modules):
        network.layers[index] = module
    return ConvertedKeras(
        specs, network.state_dict(), (*rows, channels), chain.scale, notes, network.outputs
    )


class _Chain:
    """The specs of a model's layers.

    Attributes:
        specs: specs of all layers.
        owners: index of the layer in the model of each spec.
        scale: scale at the network's input; None if it is not known.
        understood: text on each layer of the model.
    """

    def __init__(
        self, model: KerasModel, scale: Sequence[float] | None, lambdas: Sequence[str] | None
    ) -> None:
        self.model = model
        self.scale = (float(scale[0]), float(scale[1])) if scale is not None else None
        self._given = self.scale is not None
        self._words = list(lambdas or [])
        self._scaled = False  # whether a layer of the file was taken as the scale
        self.specs: list[Spec] = []
        self.owners: list[int] = []
        self.understood: list[str] = []
        for index, layer in enumerate(model.layers):
            found, understood = self._layer(index, layer)
            self.specs += found
            self.owners += [index] * len(found)
            self.understood.append(understood)
        if self._words:
            raise InputError(
                f"{model.path}: lambdas={','.join(map(str, lambdas or []))!s:.100} has more words "
                "than the file has unclear Lambdas; leave out the last"
            )

    def label(self, index: int) -> str:
        """Return a layer's position, name and class, for messages."""
        layer = self.model.layers[index]
        total = len(self.model.layers)
        return f"layer {index + 1} of {total}, {layer.name!s:.60} ({layer.kind!s:.60})"

    def _layer(self, index: int, layer: KerasLayer) -> tuple[list[Spec], str]:
        label = f"{self.model.path}: {self.label(index)}"
        if layer.kind == "Lambda":
            return self._lambda(layer, label)
        operator = layer.config.get("function") if layer.kind == "TFOpLambda" else layer.kind
        found = operator_specs(str(operator), layer.constants)
        try:
            if found is None:
                found = specs_of(layer.kind, layer.config, self.model.version)
        except UnknownValueError as error:
            raise InputError(f"{label}: {error}, which cannot be converted") from None
        if found is None and layer.kind in RECURRENT:
            raise InputError(
                f"{label}: needs several frames in a row; only networks of one image are converted"
            )
        if found is None:
            raise InputError(
                f"{label}: is an unknown layer; replace it in Keras, and save the model again"
            )
        if found and found[0]["layer"] == "Rescaling" and self._takes_scale(found[0]):
            return [], self._scale_text()
        return found, _described(found)

    def _lambda(self, layer: KerasLayer, label: str) -> tuple[list[Spec], str]:
        word, holds = describe_lambda(layer.config)
        if word is None and self._words:
            word = str(self._words.pop(0))
        elif word is None and self._takes_given_scale():
            return [], f"taken as {self._scale_text()}; holds {holds}"
        if word is None:
            raise InputError(
                f"{label}: what it computes is not clear (its code holds {holds}, and is never "
                "run); set scale=[divisor,subtracted] if it computes pixel / divisor - subtracted, "
                f"or lambdas=[WORD] with one of {WORDS}"
            )
        found = specs_of_word(word)
        if found is None:
            raise InputError(f"{label}: lambdas={word!s:.60}: is none of {WORDS}; correct it")
        if found and found[0]["layer"] == "Rescaling" and self._takes_scale(found[0]):
            return [], self._scale_text()
        return found, word

    def _takes_given_scale(self) -> bool:
        """Take an unclear Lambda as the scale that the user set, if it is the first scale."""
        takes = self._given and not self._scaled and self._is_at_input()
        self._scaled = self._scaled or takes
        return takes

    def _is_at_input(self) -> bool:
        return all(one["layer"] in BEFORE_SCALE for one in self.specs)

    def _scale_text(self) -> str:
        divisor, less = self.scale or (1.0, 0.0)
        return f"scale=[{divisor:g},{less:g}]: pixel / {divisor:g} - {less:g}"

    def _takes_scale(self, spec: Spec) -> bool:
        """Take a rescaling as the network's scale; return False if its place forbids it."""
        factor, offset = spec.get("scale"), spec.get("offset", 0.0)
        plain = all(type(one) in (int, float) for one in (factor, offset))
        if not plain or not factor or not self._is_at_input():
            return False
        if not self._given:
            divisor, less = self.scale if self.scale and self._scaled else (1.0, 0.0)
            divisor, less = divisor / factor, less * factor - offset
            self.scale = (float(f"{divisor:.12g}"), float(f"{less:.12g}"))
        self._scaled = True
        return True


def _described(specs: list[Spec]) -> str:
    if not specs:
        return "no effect in driving"
    parts = []
    for spec in specs:
        values = [f"{key}={value}" for key, value in spec.items() if key != "layer"]
        parts.append(" ".join([spec["layer"], *values]))
    return ", ".join(parts).replace(", ", ",")


def _notes(
    model: KerasModel, chain: _Chain, shapes: list[tuple[int, ...]], shape: tuple[int, ...]
) -> list[LayerNote]:
    notes = []
    for index, (layer, understood) in enumerate(zip(model.layers, chain.understood, strict=True)):
        own = [one for one, owner in zip(shapes, chain.owners, strict=True) if owner == index]
        shape = own[-1] if own else shape
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
    shape = _saved_shape(model)
    channels = shape[0 if first else 2] if shape is not None and len(shape) == 3 else None
    if shape is not None and len(shape) != 3:
        raise InputError(
            f"{model.path}: its input is {by(shape)}, not an image of rows, columns and channels; "
            "only networks of one image are converted"
        )
    if channels is None:
        channels = _kernel_channels(model)
    sides = list(shape[1:] if first else shape[:2]) if shape is not None else [None, None]
    if None in sides and size is not None:
        sides = list(size)
    if None in sides or type(channels) is not int:
        raise InputError(
            f"{model.path}: has no size of its input; set size=[rows,columns] of the images in "
            "its training, such as size=[66,200]"
        )
    if channels not in (1, 3):
        raise InputError(
            f"{model.path}: its input has {channels} channels; only images of 1 or 3 are converted"
        )
    rows, columns = sides
    if any(type(one) is not int or not 1 <= one <= 4096 for one in sides):
        raise InputError(f"{model.path}: its input of {rows} x {columns} is not 1 to 4096 pixels")
    return (channels, rows, columns) if first else (rows, columns, channels)


def _saved_shape(model: KerasModel) -> list | None:
    """Return the shape of an image that a layer's config has."""
    for layer in model.layers[:3]:
        for key in ("batch_input_shape", "batch_shape"):
            shape = layer.config.get(key)
            if isinstance(shape, list) and len(shape) > 1:
                return shape[1:]
    return None


def _kernel_channels(model: KerasModel) -> int | None:
    for layer in model.layers:
        if layer.arrays:
            kernel = layer.arrays[0]
            is_conv = CLASSES.get(layer.kind, layer.kind).endswith("Conv2D") and kernel.ndim == 4
            return int(kernel.shape[2]) if is_conv else None
    return None


def _output_specs(
    model: KerasModel, shape: tuple[int, ...], outputs: Sequence[str] | None
) -> list[Spec]:
    """Return the specs that bring the outputs into the order steering, throttle."""
    count = 1
    for one in shape:
        count *= one
    flat: list[Spec] = [] if len(shape) == 1 else [{"layer": "Flatten"}]
    if count == 1:
        return flat
    if count > 4 and outputs is None:
        raise InputError(
            f"{model.path}: has {count} outputs, so it is a network of another task; name one that "
            "returns the steering"
        )
    names = list(outputs or [])
    known = ("steering", "throttle", "ignored")
    if len(names) != count or names.count("steering") != 1 or names.count("throttle") > 1:
        raise InputError(
            f"{model.path}: has {count} outputs; name each with outputs=["
            f"{','.join((*known[:2], *['ignored'] * count)[:count])}], steering once"
        )
    if set(names) - set(known):
        raise InputError(f"{model.path}: outputs={names!s:.100}: known are {', '.join(known)}")
    columns = [names.index(one) for one in known[:2] if one in names]
    return [*flat, {"layer": "Select", "columns": columns}]


def _remedy(error: MisfitError, shape: tuple[int, ...], first: bool) -> str:
    if not error.follows_input:
        return "; the file is damaged or of another model: save the model again"
    rows = shape[1:] if first else shape[:2]
    return f"; the images of its training were not {by(rows)}: set size=[rows,columns]"

"""Weights of the Keras era: `.h5` files of the zoo's networks, as Keras 1 and 2 wrote them.

Formats: Keras' `saving/hdf5_format.py` (2.x) and `engine/topology.py` (1.x). Nothing in the file is
run: Lambda layers, whose code it may hold, are passed over.
"""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import nn

from datamodules.errors import InputError


@dataclass(frozen=True)
class KerasLayer:
    """A layer with weights, as in the file: `kernel` and, where there is one, `bias`."""

    name: str
    kernel: np.ndarray
    bias: np.ndarray | None


@dataclass(frozen=True)
class KerasFile:
    """A file's layers in order, and what of the model matters for reading them.

    Attributes:
        channels_first: True or False as the model says; None where only weights were saved.
        flips: Keras 1 on Theano, which turned every kernel around.
        hint: the input and the cropping of the model, in words, where it is known.
    """

    layers: list[KerasLayer]
    channels_first: bool | None
    flips: bool
    hint: str


def load_keras_weights(network: nn.Module, path: Path) -> str:
    """Load a Keras `.h5` (a whole model or weights alone) into `network`, and say what was loaded.

    Layers are paired in order. Kernels go from (h, w, in, out) to torch's (out, in, h, w), and the
    first dense layer's rows from Keras' flatten order (h, w, c) to torch's (c, h, w).

    Raises:
        InputError: no HDF5 file, or one that does not fit; names the layer that differs.
    """
    file = read_keras_file(path)
    kind = type(network).__name__
    places = [m for m in network.modules() if isinstance(m, nn.Conv1d | nn.Conv2d | nn.Linear)]
    if len(file.layers) != len(places):
        names = ", ".join(layer.name for layer in file.layers)
        raise InputError(
            f"{path}: has {len(file.layers)} layers with weights ({names}), {kind} has "
            f"{len(places)}; choose the model that it was made with"
        )
    state: list[tuple[nn.Parameter, np.ndarray]] = []
    channels = None  # of the last convolution, until the first dense layer has used them
    for number, (layer, place) in enumerate(zip(file.layers, places, strict=True), start=1):
        label = f"{path}: layer {number} of {len(places)}, {layer.name}"
        if isinstance(place, nn.Linear):
            kernel = _dense_kernel(layer.kernel, channels if not file.channels_first else None)
            channels = None
        else:
            kernel = _convolution_kernel(layer.kernel, place, file)
            channels = place.out_channels
        if kernel is None or kernel.shape != tuple(place.weight.shape):
            raise InputError(
                f"{label}: kernel {_by(layer.kernel.shape)} in the file does not fit "
                f"{_by(place.weight.shape)} (out x in) of {kind}; set model.size, model.colour and "
                f"data.crop to the file's input{file.hint}"
            )
        if layer.bias is None or layer.bias.shape != tuple(place.bias.shape):
            raise InputError(f"{label}: has no bias that fits {kind}; choose the model it is of")
        state += [(place.weight, kernel), (place.bias, layer.bias)]
    with torch.no_grad():
        for parameter, array in state:
            parameter.copy_(torch.from_numpy(np.ascontiguousarray(array)))
    return f"{len(places)} layers from {path} (Keras){file.hint}"


def read_keras_file(path: Path) -> KerasFile:
    """The layers of a `.h5` file.

    Raises:
        InputError: h5py is not installed, or the file is none of Keras 1 or 2.
    """
    try:
        import h5py
    except ImportError:
        raise InputError(f"{path}: reading it needs h5py; pip install 'drivezoo[keras]'") from None
    try:
        with h5py.File(path) as file:
            group = file.get("model_weights", file)
            if "layer_names" not in group.attrs and "layer_names0" not in group.attrs:
                raise InputError(
                    f"{path}: holds no layers of Keras 1 or 2; save the model with "
                    "model.save('model.h5'), not as .weights.h5 or .keras"
                )
            config = json.loads(_text(file.attrs.get("model_config", "{}")) or "{}")
            version = _text(group.attrs.get("keras_version", file.attrs.get("keras_version", "")))
            backend = _text(group.attrs.get("backend", file.attrs.get("backend", "")))
            layers = [
                layer
                for name in _names(group, "layer_names")
                for layer in _layers_of(group[name], name)
            ]
    except (OSError, KeyError, ValueError) as error:
        raise InputError(f"{path}: is no whole HDF5 file of Keras ({error})") from None
    return KerasFile(
        layers=layers,
        channels_first=_channels_first(config),
        flips=version.startswith("1") and backend == "theano",
        hint=_input_hint(config),
    )


def _layers_of(group, name: str) -> list[KerasLayer]:
    """A layer's arrays in pairs of kernel and bias; a nested model has several pairs."""
    layers: list[KerasLayer] = []
    for weight_name in _names(group, "weight_names"):
        array = np.asarray(group[weight_name])
        if array.ndim == 1 and layers and layers[-1].bias is None:
            layers[-1] = KerasLayer(layers[-1].name, layers[-1].kernel, array)
        else:
            layers.append(KerasLayer(name, array, None))
    return layers


def _names(group, attribute: str) -> list[str]:
    """A list of names in an attribute, which Keras cuts in numbered pieces where it is long."""
    if attribute in group.attrs:
        return [_text(name) for name in group.attrs[attribute]]
    names: list[str] = []
    piece = 0
    while f"{attribute}{piece}" in group.attrs:
        names += [_text(name) for name in group.attrs[f"{attribute}{piece}"]]
        piece += 1
    return names


def _text(value: bytes | str) -> str:
    return value.decode() if isinstance(value, bytes) else str(value)


def _dense_kernel(kernel: np.ndarray, channels: int | None) -> np.ndarray | None:
    """(in, out) -> (out, in); with `channels`, rows from (pixels, channels) to the reverse."""
    if kernel.ndim != 2:
        return None
    if channels is not None:
        if len(kernel) % channels:
            return None
        pixels = len(kernel) // channels
        kernel = kernel.reshape(pixels, channels, -1).transpose(1, 0, 2).reshape(len(kernel), -1)
    return kernel.T


def _convolution_kernel(
    kernel: np.ndarray, place: nn.Conv1d | nn.Conv2d, file: KerasFile
) -> np.ndarray | None:
    """To torch's (out, in, h, w), or (out, in, columns)."""
    if isinstance(place, nn.Conv1d):
        if kernel.ndim == 4 and kernel.shape[0] == 1:  # a 1 x n convolution in two dimensions
            kernel = kernel[0]
        return kernel.transpose(2, 1, 0) if kernel.ndim == 3 else None
    if kernel.ndim != 4:
        return None
    # Keras 2 keeps (h, w, in, out) whatever the model's order; Keras 1 kept (out, in, h, w) too.
    rows_first = kernel.shape == tuple(np.array(place.weight.shape)[[2, 3, 1, 0]])
    if rows_first or kernel.shape != tuple(place.weight.shape):
        kernel = kernel.transpose(3, 2, 0, 1)
    return kernel[:, :, ::-1, ::-1] if file.flips else kernel


def _model_layers(config: dict) -> list[dict]:
    """The layers' own configs, outer first, of any nesting and version."""
    inner = config.get("config", [])
    entries = inner.get("layers", []) if isinstance(inner, dict) else inner
    found = []
    for entry in entries:
        if isinstance(entry, dict):
            found.append(entry)
            found += _model_layers(entry)
    return found


def _channels_first(config: dict) -> bool | None:
    for layer in _model_layers(config):
        own = layer.get("config")
        order = isinstance(own, dict) and (own.get("dim_ordering") or own.get("data_format"))
        if order:
            return order in ("th", "channels_first")
    return None


def _input_hint(config: dict) -> str:
    """`: it was fed 66 x 200 x 3 and crops ((50, 20), (0, 0))`, as far as the file says."""
    parts = []
    for layer in _model_layers(config):
        own = layer.get("config")
        if not isinstance(own, dict):
            continue
        shape = own.get("batch_input_shape") or own.get("batch_shape")
        if shape and not parts:
            parts.append(f"it was fed {_by(shape[1:])}")
        if own.get("cropping"):
            parts.append(f"crops {own['cropping']} itself")
    return f": {' and '.join(parts)}" if parts else ""


def _by(shape) -> str:
    return " x ".join(str(size) for size in shape)

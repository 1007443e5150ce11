"""Read weights of the zoo's networks from `.h5` files of Keras 1 and 2.

The formats are defined in Keras' `saving/hdf5_format.py` (2.x) and `engine/topology.py` (1.x).
Nothing in the file is run: Lambda layers, which may contain code, are ignored.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from datamodules.errors import InputError
from datamodules.regular_file import open_binary

MOST_BYTES = 8_000_000_000
WithWeights = nn.Conv1d | nn.Conv2d | nn.Linear


@dataclass(frozen=True)
class KerasLayer:
    """A layer's weights as in the file; `bias` is None if the layer has none."""

    name: str
    kernel: np.ndarray
    bias: np.ndarray | None


@dataclass(frozen=True)
class KerasFile:
    """A file's layers in order, and the facts of the model that are needed to read them.

    Attributes:
        layers: layers with weights.
        version: Keras' major version; 1 if the file does not name it, as in Keras itself.
        backend: `tensorflow`, `theano` ...; empty before Keras 1.2, which did not save it.
        channels_first: order of the model's axes; None if only weights were saved.
        flattens_channels_last: whether its Flatten puts the channels last in any case.
        fed: text on the model's input and cropping; empty if they are not known.
        settings: text on the settings for that input.
    """

    layers: list[KerasLayer]
    version: int
    backend: str
    channels_first: bool | None
    flattens_channels_last: bool
    fed: str
    settings: str


def load_keras_weights(network: nn.Module, path: Path) -> str:
    """Load a Keras `.h5` file into `network`, and return one line on what was loaded.

    The file holds a whole model or only weights. Layers are paired in order. Kernels change from
    (h, w, in, out) to torch's (out, in, h, w), and the first dense layer's rows from Keras' flatten
    order (h, w, c) to torch's (c, h, w).

    Raises:
        InputError: the file is not HDF5, or does not fit; names the layer that differs.
    """
    file = read_keras_file(path)
    kind = type(network).__name__
    places = [m for m in network.modules() if isinstance(m, WithWeights)]
    if len(file.layers) != len(places):
        names = ", ".join(layer.name for layer in file.layers)
        raise InputError(
            f"{path}: has {len(file.layers)} layers with weights ({names}), {kind} has "
            f"{len(places)}; set the model of the file's training"
        )
    state: list[tuple[torch.Tensor, np.ndarray]] = []
    channels_first = file.channels_first
    channels = None  # of the last convolution; None after the first dense layer
    for number, (layer, place) in enumerate(zip(file.layers, places, strict=True), start=1):
        label = f"{path}: layer {number} of {len(places)}, {layer.name}"
        kernel = _torch_kernel(layer.kernel, place, file)
        if kernel is None:
            is_first_dense = isinstance(place, nn.Linear) and channels is not None
            follows_size = is_first_dense or isinstance(
                place, nn.Conv1d
            )  # Conv1d's inputs are rows
            raise InputError(
                f"{label}: kernel {_by(layer.kernel.shape)} in the file, "
                f"{_by(_keras_shape(place))} in {kind}: {_fix(number, follows_size, file)}"
            )
        if layer.bias is None or place.bias is None or layer.bias.shape != tuple(place.bias.shape):
            raise InputError(
                f"{label}: has no bias that fits {kind}; set the model of its training"
            )
        if not isinstance(place, nn.Linear):
            channels = place.out_channels
            if channels_first is None and isinstance(place, nn.Conv2d):
                channels_first = _is_out_in_first(layer.kernel, place, file) or None
        elif channels is not None:
            if file.flattens_channels_last or not channels_first:
                kernel = _channels_first_inputs(kernel, channels)
            channels = None
        state += [(place.weight, kernel), (place.bias, layer.bias)]
    with torch.no_grad():
        for parameter, array in state:
            parameter.copy_(torch.from_numpy(np.ascontiguousarray(array)))
    # Keras before 1.2 did not save the backend. Kernels of Theano, its default, must be flipped.
    doubt = "; no backend in the file, read as TensorFlow's, not Theano's"
    doubt = doubt if channels_first and not file.backend else ""
    return f"{len(places)} layers from {path} (Keras {file.version}{doubt}){file.fed}"


def read_keras_file(path: Path) -> KerasFile:
    """Return the layers of a `.h5` file.

    Raises:
        InputError: h5py is not installed, or the file is not of Keras 1 or 2.
    """
    try:
        import h5py
    except ImportError:
        raise InputError(
            f"{path}: h5py, which reads it, is not installed; pip install h5py"
        ) from None
    from zoo.runs.bounded_files import parse_json

    try:
        with open_binary(path, MOST_BYTES) as raw, h5py.File(raw) as file:
            group = file.get("model_weights", file)
            if "layer_names" not in group.attrs and "layer_names0" not in group.attrs:
                raise InputError(
                    f"{path}: holds no layers of Keras 1 or 2; save the model with "
                    "model.save('model.h5'), not as .weights.h5 or .keras"
                )
            config = parse_json(_text(file.attrs.get("model_config", "{}")))
            version = _text(group.attrs.get("keras_version", file.attrs.get("keras_version", "1")))
            model = _model_layers(config)
            channels_first = _channels_first(model)
            fed, settings = _input(model, channels_first)
            return KerasFile(
                layers=[
                    layer
                    for name in _names(group, "layer_names")
                    for layer in _layers_of(group[name], name)
                ],
                version=int(version.partition(".")[0]),
                backend=_text(group.attrs.get("backend", file.attrs.get("backend", ""))),
                channels_first=channels_first,
                flattens_channels_last=any(
                    name == "Flatten" and own.get("data_format") == "channels_first"
                    for name, own in model
                ),
                fed=fed,
                settings=settings,
            )
    except InputError:
        raise
    except OSError as error:
        reason = error.strerror or " ".join(str(error).split())
        raise InputError(
            f"{path}: is not a complete HDF5 file of Keras ({reason}); copy it again"
        ) from None
    except Exception as error:  # h5py and json raise any error on damaged bytes
        reason = " ".join(str(error).split())
        raise InputError(
            f"{path}: is not a complete HDF5 file of Keras ({reason}); copy it again"
        ) from None


def _layers_of(group: Any, name: str) -> list[KerasLayer]:
    """Return a layer's arrays in pairs of kernel and bias; a nested model has several pairs."""
    layers: list[KerasLayer] = []
    for weight_name in _names(group, "weight_names"):
        array = group[weight_name][()].astype(np.float32, casting="same_kind")
        if array.ndim == 1 and layers and layers[-1].bias is None:
            layers[-1] = KerasLayer(layers[-1].name, layers[-1].kernel, array)
        else:
            layers.append(KerasLayer(name, array, None))
    return layers


def _names(group: Any, attribute: str) -> list[str]:
    """Return the list of names in an attribute; Keras splits a long one into numbered parts."""
    if attribute in group.attrs:
        return [_text(name) for name in group.attrs[attribute]]
    names: list[str] = []
    part = 0
    while f"{attribute}{part}" in group.attrs:
        names += [_text(name) for name in group.attrs[f"{attribute}{part}"]]
        part += 1
    return names


def _text(value: bytes | str) -> str:
    return value.decode() if isinstance(value, bytes) else str(value)


def _keras_shape(place: WithWeights) -> tuple[int, ...]:
    """Return a kernel's shape in Keras: (h, w, in, out), (columns, in, out) or (in, out)."""
    out, inputs, *window = place.weight.shape
    return (*window, inputs, out)


def _is_out_in_first(kernel: np.ndarray, place: WithWeights, file: KerasFile) -> bool:
    """Return whether a kernel has torch's axes, as in Keras 1 with the channels first."""
    if kernel.shape != tuple(place.weight.shape) or isinstance(place, nn.Linear):
        return False
    # If all sizes are equal, the shape does not tell the order.
    return kernel.shape != _keras_shape(place) or (file.version == 1 and bool(file.channels_first))


def _torch_kernel(kernel: np.ndarray, place: WithWeights, file: KerasFile) -> np.ndarray | None:
    """Return a kernel with torch's axes, for correlation; None if it does not fit."""
    if isinstance(place, nn.Conv1d) and kernel.ndim == 4:
        # (1, columns, in, out) from Conv2D or Keras 1.2; (out, in, columns, 1) from 1.0.
        if kernel.shape == (*place.weight.shape, 1):
            kernel = kernel[..., 0].transpose(2, 1, 0)
        elif kernel.shape[0] == 1:
            kernel = kernel[0]
    if not _is_out_in_first(kernel, place, file):
        if kernel.shape != _keras_shape(place):
            return None
        kernel = np.moveaxis(kernel, (-1, -2), (0, 1))
    # Theano convolves; all other backends correlate.
    flips = file.backend == "theano" and isinstance(place, nn.Conv1d | nn.Conv2d)
    return np.flip(kernel, tuple(range(2, kernel.ndim))) if flips else kernel


def _channels_first_inputs(kernel: np.ndarray, channels: int) -> np.ndarray:
    """Return a kernel [out, in] whose inputs are (channels, pixels), not (pixels, channels)."""
    size = kernel.shape[1] // channels * channels  # after them, the speed of `nvidia_speed`
    pixels = kernel[:, :size].reshape(len(kernel), -1, channels).transpose(0, 2, 1)
    return np.concatenate([pixels.reshape(len(kernel), size), kernel[:, size:]], axis=1)


def _fix(number: int, follows_size: bool, file: KerasFile) -> str:
    """Return the remedy for a kernel that does not fit; it depends on the layer's position."""
    if follows_size:
        return f"the view differs; set {file.settings}{file.fed}"
    if number == 1:
        return f"set model.colour, or the model of the file's training{file.fed}"
    return "set model.width, or the model of the file's training"


def _model_layers(config: Any) -> list[tuple[str, dict]]:
    """Return the layers' classes and configs, outer layers first, for every Keras version."""
    inner = config.get("config", [])
    found = []
    for entry in inner.get("layers", []) if isinstance(inner, dict) else inner:
        own = entry.get("config")
        found.append((entry.get("class_name", ""), own if isinstance(own, dict) else {}))
        found += _model_layers(entry)
    return found


def _channels_first(model: list[tuple[str, dict]]) -> bool | None:
    for name, own in model:
        order = own.get("dim_ordering") or own.get("data_format")
        if order and name != "Flatten":
            return order in ("th", "channels_first")
    return None


def _input(model: list[tuple[str, dict]], channels_first: bool | None) -> tuple[str, str]:
    """Return texts on the model's input, such as `: its input is 160 x 320 x 3`, and settings."""
    configs = [own for _, own in model]
    shapes = [own.get("batch_input_shape") or own.get("batch_shape") for own in configs]
    shape = next((shape[1:] for shape in shapes if shape), None)
    fed = f": its input is {_by(shape)}" if shape else ""
    settings = "model.size and data.crop to the file's input"
    crop = next((own["cropping"][0] for own in configs if own.get("cropping")), None)
    if shape and crop:
        fed += f", cropped by {crop[0]} rows at the top and {crop[1]} at the bottom"
    *size, channels = [*shape[1:], shape[0]] if shape and channels_first else shape or [None]
    if channels in (1, 3) and len(size) == 2 and None not in size:
        settings = f"model.size=[{size[0]},{size[1]}]"
        if crop:
            settings = f"data.crop=[{crop[0]},{crop[1]}] model.size=null"
    return fed, settings


def _by(shape: Iterable[object]) -> str:
    return " x ".join(str(size) for size in shape)

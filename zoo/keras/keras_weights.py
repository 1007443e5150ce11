"""Copy the weights of Keras layers into layers of torch.

`copy_arrays` fills a module that was built from the layer's spec, `load_keras_weights` a network of
the zoo that has the same layers.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from zoo.base.errors import InputError
from zoo.keras.keras_file import read_keras_apart
from zoo.keras.keras_model import KerasLayer, KerasModel
from zoo.keras.keras_specs import ORDERS
from zoo.models.value_layers import BatchNorm, PReLU
from zoo.models.window_builders import by

WithWeights = nn.Conv1d | nn.Conv2d | nn.Linear


class MisfitError(ValueError):
    """An error about an array that does not fit its layer.

    Attributes:
        follows_input: whether another size of the input would change the wanted shape.
    """

    def __init__(self, message: str, follows_input: bool = False) -> None:
        super().__init__(message)
        self.follows_input = follows_input


def copy_arrays(layer: KerasLayer, module: nn.Module, model: KerasModel, first: bool) -> None:
    """Copy a layer's arrays into its module.

    Args:
        layer: layer of the file.
        module: module, which has the parameters of this layer alone.
        model: file's model, for its version and backend.
        first: whether the images are channels first.

    Raises:
        MisfitError: number or shapes of the arrays are other than the module's.
    """
    places = [
        (name, one)
        for part in module.modules()
        if isinstance(part, (nn.Conv2d, nn.Linear, BatchNorm, PReLU))
        for name, one in _tensors(part)
    ]
    if len(places) != len(layer.arrays):
        raise MisfitError(
            f"has {len(layer.arrays)} arrays of weights in the file, and needs {len(places)}; save "
            "the model again, or name the weights of this architecture"
        )
    for (name, place), array in zip(places, layer.arrays, strict=True):
        found = _arranged(name, array, place, layer, model, first)
        if found is None or found.shape != tuple(place.shape):
            wanted = _keras_shape(place) if name != "alpha" else _alpha_shape(place, first)
            raise MisfitError(
                f"its {name} is {by(array.shape)} in the file, {by(wanted)} for its input",
                name in ("kernel", "alpha") and (place.ndim == 2 or name == "alpha"),
            )
        if not np.isfinite(found).all():
            raise MisfitError("its weights hold NaN or infinity; the training diverged")
        with torch.no_grad():
            place.copy_(torch.from_numpy(np.ascontiguousarray(found)))


def _tensors(part: nn.Conv2d | nn.Linear | BatchNorm | PReLU) -> list[tuple[str, Tensor]]:
    """Return a module's tensors in the order of Keras, with Keras' names."""
    if isinstance(part, PReLU):
        return [("alpha", part.alpha)]
    if isinstance(part, BatchNorm):
        found: dict[str, Tensor] = {"gamma": part.weight, "beta": part.bias}
        found = {name: one for name, one in found.items() if one.requires_grad}
        buffers = dict(part.named_buffers())
        found |= {"mean": buffers["running_mean"], "variance": buffers["running_var"]}
        return list(found.items())
    is_depthwise = isinstance(part, nn.Conv2d) and part.groups == part.in_channels > 1
    name = "depthwise kernel" if is_depthwise else "kernel"
    return [(name, part.weight), *([("bias", part.bias)] if part.bias is not None else [])]


def _arranged(
    name: str, array: np.ndarray, place: Tensor, layer: KerasLayer, model: KerasModel, first: bool
) -> np.ndarray | None:
    """Return an array with torch's axes; None if its number of axes is wrong."""
    if name == "alpha":
        return np.moveaxis(array, -1, 0) if array.ndim == 3 and not first else array
    if "kernel" not in name:
        return array
    if place.ndim == 2:
        return array.T if array.ndim == 2 else None
    if layer.kind.endswith("1D") and array.ndim in (3, 4):
        array = _one_row(array, place)
    if array.ndim != 4:
        return None
    if name == "depthwise kernel" and _is_separable(layer):
        found = array.transpose(2, 3, 0, 1)  # (h, w, channels, multiplier)
        return found.reshape(-1, 1, *found.shape[2:])
    old = model.version == 1 and first and array.shape == tuple(place.shape)
    kernel = array if old else array.transpose(3, 2, 0, 1)  # (h, w, in, out)
    # Theano convolves; all other backends correlate.
    flips = model.backend == "theano" and not _is_separable(layer)
    return kernel[:, :, ::-1, ::-1] if flips else kernel


def _is_separable(layer: KerasLayer) -> bool:
    return layer.kind.startswith(("Separable", "Depthwise"))


def _one_row(array: np.ndarray, place: Tensor) -> np.ndarray:
    """Return the kernel of a 1-D convolution as (1, steps, in, out)."""
    if array.ndim == 3:
        return array[None]
    out, inputs, _, steps = place.shape
    if array.shape == (out, inputs, steps, 1):  # Keras 1.0
        return array.transpose(3, 2, 1, 0)
    return array.transpose(1, 0, 2, 3) if array.shape[1] == 1 else array  # Keras 1.2


def _keras_shape(tensor: Tensor) -> tuple[int, ...]:
    """Return a tensor's shape in Keras: a kernel's is (h, w, in, out), (steps, in, out), (in, out).

    >>> _keras_shape(torch.empty(24, 3, 5, 5)), _keras_shape(torch.empty(24))
    ((5, 5, 3, 24), (24,))
    """
    out, *rest = tensor.shape
    return (*rest[1:], rest[0], out) if rest else (out,)


def _alpha_shape(alpha: Tensor, first: bool) -> tuple[int, ...]:
    """Return the shape of a PReLU's factors in Keras' order of axes."""
    shape = tuple(alpha.shape)
    return (*shape[1:], shape[0]) if len(shape) == 3 and not first else shape


@dataclass(frozen=True)
class Pair:
    """A layer's kernel and bias; `bias` is None if the layer has none."""

    name: str
    kernel: np.ndarray
    bias: np.ndarray | None


def load_keras_weights(network: nn.Module, path: Path) -> str:
    """Load a Keras file into `network`, and return one line on what was loaded.

    The file holds a whole model or only weights. Layers are paired in order. Kernels change from
    (h, w, in, out) to torch's (out, in, h, w), and the first dense layer's rows from Keras' flatten
    order (h, w, c) to torch's (c, h, w).

    Raises:
        InputError: the file is not Keras', or does not fit; names the layer that differs.
    """
    model = read_keras_apart(path, None, False, False)
    pairs = [pair for layer in model.layers for pair in _pairs(layer)]
    kind = type(network).__name__
    places = [m for m in network.modules() if isinstance(m, WithWeights)]
    if len(pairs) != len(places):
        names = ", ".join(pair.name for pair in pairs)
        raise InputError(
            f"{path}: has {len(pairs)} layers with weights ({names!s:.500}), {kind} has "
            f"{len(places)}; set the model of the file's training, or model=keras for any"
        )
    state: list[tuple[torch.Tensor, np.ndarray]] = []
    first = _channels_first(model)
    channels = None  # of the last convolution; None after the first dense layer
    for number, (pair, place) in enumerate(zip(pairs, places, strict=True), start=1):
        label = f"{path}: layer {number} of {len(places)}, {pair.name}"
        kernel = _torch_kernel(pair.kernel, place, model, bool(first))
        if kernel is None:
            is_first_dense = isinstance(place, nn.Linear) and channels is not None
            follows_size = is_first_dense or isinstance(
                place, nn.Conv1d
            )  # Conv1d's inputs are rows
            found, wanted = by(pair.kernel.shape), by(_keras_shape(place.weight))
            raise InputError(
                f"{label}: kernel {found} in the file, {wanted} in {kind}: "
                f"{_fix(number, follows_size, model, first)}"
            )
        if pair.bias is None or place.bias is None or pair.bias.shape != tuple(place.bias.shape):
            raise InputError(
                f"{label}: has no bias that fits {kind}; set the model of its training"
            )
        if not isinstance(place, nn.Linear):
            channels = place.out_channels
            if first is None and isinstance(place, nn.Conv2d):
                first = _is_out_in_first(pair.kernel, place, model, False) or None
        elif channels is not None:
            if not first or _flattens_channels_last(model):
                kernel = _channels_first_inputs(kernel, channels)
            channels = None
        state += [(place.weight, kernel), (place.bias, pair.bias)]
    with torch.no_grad():
        for parameter, array in state:
            parameter.copy_(torch.from_numpy(np.ascontiguousarray(array)))
    # Keras before 1.2 did not save the backend. Kernels of Theano, its default, must be flipped.
    doubt = "; no backend in the file, read as TensorFlow's, not Theano's"
    doubt = doubt if first and not model.backend else ""
    return (
        f"{len(places)} layers from {path} (Keras {model.version}{doubt}){_input(model, first)[0]}"
    )


def _pairs(layer: KerasLayer) -> list[Pair]:
    """Return a layer's arrays in pairs of kernel and bias; a nested model has several pairs."""
    pairs: list[Pair] = []
    for array in layer.arrays:
        if array.ndim == 1 and pairs and pairs[-1].bias is None:
            pairs[-1] = Pair(layer.name, pairs[-1].kernel, array)
        else:
            pairs.append(Pair(layer.name, array, None))
    return pairs


def _is_out_in_first(
    kernel: np.ndarray, place: WithWeights, model: KerasModel, first: bool
) -> bool:
    """Return whether a kernel has torch's axes, as in Keras 1 with the channels first."""
    if kernel.shape != tuple(place.weight.shape) or isinstance(place, nn.Linear):
        return False
    # If all sizes are equal, the shape does not tell the order.
    return kernel.shape != _keras_shape(place.weight) or (model.version == 1 and first)


def _torch_kernel(
    kernel: np.ndarray, place: WithWeights, model: KerasModel, first: bool
) -> np.ndarray | None:
    """Return a kernel with torch's axes, for correlation; None if it does not fit."""
    if isinstance(place, nn.Conv1d) and kernel.ndim == 4:
        # (1, columns, in, out) from Conv2D or Keras 1.2; (out, in, columns, 1) from 1.0.
        if kernel.shape == (*place.weight.shape, 1):
            kernel = kernel[..., 0].transpose(2, 1, 0)
        elif kernel.shape[0] == 1:
            kernel = kernel[0]
    if not _is_out_in_first(kernel, place, model, first):
        if kernel.shape != _keras_shape(place.weight):
            return None
        kernel = np.moveaxis(kernel, (-1, -2), (0, 1))
    # Theano convolves; all other backends correlate.
    flips = model.backend == "theano" and isinstance(place, nn.Conv1d | nn.Conv2d)
    return np.flip(kernel, tuple(range(2, kernel.ndim))) if flips else kernel


def _channels_first_inputs(kernel: np.ndarray, channels: int) -> np.ndarray:
    """Return a kernel [out, in] whose inputs are (channels, pixels), not (pixels, channels)."""
    size = kernel.shape[1] // channels * channels  # after them, the speed of `nvidia_speed`
    pixels = kernel[:, :size].reshape(len(kernel), -1, channels).transpose(0, 2, 1)
    return np.concatenate([pixels.reshape(len(kernel), size), kernel[:, size:]], axis=1)


def _fix(number: int, follows_size: bool, model: KerasModel, first: bool | None) -> str:
    """Return the remedy for a kernel that does not fit; it depends on the layer's position."""
    fed, settings = _input(model, first)
    if follows_size:
        return f"the view differs; set {settings}{fed}"
    if number == 1:
        return f"set model.colour, or the model of the file's training{fed}"
    return "set model.width, or the model of the file's training"


def _order(layer: KerasLayer) -> str | None:
    order = layer.config.get("data_format") or layer.config.get("dim_ordering")
    return ORDERS.get(order) if isinstance(order, str) else None


def _channels_first(model: KerasModel) -> bool | None:
    """Return whether the model's images are channels first; None if the file does not tell."""
    orders = (_order(layer) for layer in model.layers if layer.kind != "Flatten")
    order = next((one for one in orders if one is not None), None)
    return None if order is None else order == "channels_first"


def _flattens_channels_last(model: KerasModel) -> bool:
    flats = (layer for layer in model.layers if layer.kind == "Flatten")
    return any(layer.config.get("data_format") == "channels_first" for layer in flats)


def _input(model: KerasModel, first: bool | None) -> tuple[str, str]:
    """Return texts on the model's input, such as `: its input is 160 x 320 x 3`, and settings."""
    configs = [layer.config for layer in model.layers]
    shapes = [own.get("batch_input_shape") or own.get("batch_shape") for own in configs]
    shape = next((one[1:] for one in shapes if isinstance(one, list)), None)
    fed = f": its input is {by(shape)}" if shape else ""
    settings = "model.size and data.crop to the file's input"
    crop = next((crop for own in configs if (crop := _rows_cropped(own.get("cropping")))), None)
    if shape and crop:
        fed += f", cropped by {crop[0]} rows at the top and {crop[1]} at the bottom"
    *size, channels = [*shape[1:], shape[0]] if shape and first else shape or [None]
    if channels in (1, 3) and len(size) == 2 and None not in size:
        settings = f"model.size=[{size[0]},{size[1]}]"
        if crop:
            settings = f"data.crop=[{crop[0]},{crop[1]}] model.size=null"
    return fed, settings


def _rows_cropped(cropping: object) -> list | None:
    rows = cropping[0] if isinstance(cropping, list) and cropping else None
    return rows if isinstance(rows, list) and len(rows) == 2 else None

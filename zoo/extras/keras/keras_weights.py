"""Copy the weights of Keras layers into layers of torch.

`copy_arrays` fills a module that was built from the layer's spec, `load_keras_weights` a network of
the zoo that has the same layers.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from zoo.base.errors import InputError
from zoo.extras.keras.keras_file import read_keras_apart
from zoo.extras.keras.keras_model import KerasLayer, KerasModel
from zoo.extras.keras.keras_modules import BatchNorm, PReLU
from zoo.extras.keras.keras_specs import ORDERS
from zoo.extras.keras.layer_spec import by

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
        MisfitError: see `_arranged`.
    """
    places = [pair for part in module.modules() for pair in _tensors(part)]
    arranged = _arranged(layer.arrays, places, layer.kind, model, first)
    _copy([tensor for _, tensor in places], arranged)


def _copy(tensors: Sequence[Tensor], arrays: Sequence[np.ndarray]) -> None:
    with torch.no_grad():
        for tensor, array in zip(tensors, arrays, strict=True):
            tensor.copy_(torch.from_numpy(np.ascontiguousarray(array)))


def _tensors(part: nn.Module) -> list[tuple[str, Tensor]]:
    """Return a module's tensors in the order of Keras, with Keras' names; none of its children."""
    if isinstance(part, PReLU):
        return [("alpha", part.alpha)]
    if isinstance(part, BatchNorm):
        tensors: dict[str, Tensor] = {"gamma": part.weight, "beta": part.bias}
        tensors = {name: tensor for name, tensor in tensors.items() if tensor.requires_grad}
        buffers = dict(part.named_buffers())
        tensors |= {"mean": buffers["running_mean"], "variance": buffers["running_var"]}
        return list(tensors.items())
    if not isinstance(part, WithWeights):
        return []
    bias = [] if part.bias is None else [("bias", part.bias)]
    if isinstance(part, nn.Conv1d):
        return [("row kernel", part.weight[:, :, None]), *bias]
    is_depthwise = isinstance(part, nn.Conv2d) and part.groups == part.in_channels > 1
    return [("depthwise kernel" if is_depthwise else "kernel", part.weight), *bias]


def _arranged(
    arrays: Sequence[np.ndarray],
    places: list[tuple[str, Tensor]],
    kind: str,
    model: KerasModel,
    first: bool,
) -> list[np.ndarray]:
    """Return a layer's arrays with the axes of torch's tensors, for correlation.

    Raises:
        MisfitError: number or shapes of the arrays are other than the tensors', or one is not
            finite.
    """
    if len(places) != len(arrays):
        raise MisfitError(
            f"has {len(arrays)} arrays of weights in the file, and needs {len(places)}; save "
            "the model again, or name the weights of this architecture"
        )
    arranged = []
    for (name, tensor), array in zip(places, arrays, strict=True):
        values: np.ndarray | None = array
        if name == "alpha" and array.ndim == 3 and not first:
            values = np.moveaxis(array, -1, 0)
        elif "kernel" in name and tensor.ndim == 2:
            values = array.T if array.ndim == 2 else None
        elif "kernel" in name:
            values = _torch_kernel(name, array, tensor, kind, model, first)
        if values is None or values.shape != tuple(tensor.shape):
            wanted = _keras_shape(tensor) if "kernel" in name else tuple(tensor.shape)
            raise MisfitError(
                f"its {name} is {by(array.shape)} in the file, {by(wanted)} for its input",
                name == "alpha" or (name == "kernel" and tensor.ndim == 2),
            )
        if not np.isfinite(values).all():
            raise MisfitError("its weights hold NaN or infinity; the training diverged")
        arranged.append(values)
    return arranged


def _torch_kernel(
    name: str, array: np.ndarray, tensor: Tensor, kind: str, model: KerasModel, first: bool
) -> np.ndarray | None:
    """Return the kernel of a convolution; None if its number of axes is wrong."""
    if name == "row kernel":
        array = _one_row(array, tensor)
    if array.ndim != 4:
        return None
    is_separable = kind.startswith(("Separable", "Depthwise"))
    if name == "depthwise kernel" and is_separable:
        kernel = array.transpose(2, 3, 0, 1)  # (h, w, channels, multiplier)
        return kernel.reshape(-1, 1, *kernel.shape[2:])
    is_old = _is_out_in_first(array, tensor, model.version == 1 and first)
    kernel = array if is_old else array.transpose(3, 2, 0, 1)  # (h, w, in, out)
    # Theano convolves; all other backends correlate.
    flips = model.backend == "theano" and not is_separable
    return kernel[:, :, ::-1, ::-1] if flips else kernel


def _one_row(array: np.ndarray, tensor: Tensor) -> np.ndarray:
    """Return the kernel of a 1-D convolution as (1, steps, in, out)."""
    if array.ndim != 4:
        return array[None]
    out, inputs, _, steps = tensor.shape
    if array.shape == (out, inputs, steps, 1):  # Keras 1.0
        return array.transpose(3, 2, 1, 0)
    return array.transpose(1, 0, 2, 3) if array.shape[1] == 1 else array  # Keras 1.2


def _is_out_in_first(array: np.ndarray, tensor: Tensor, expected: bool) -> bool:
    """Return whether a kernel has torch's axes, as in Keras 1 with the channels first.

    Args:
        array: kernel in the file.
        tensor: weights of a convolution.
        expected: what to return if all sizes are equal, and the shape does not tell the order.
    """
    shape = tuple(tensor.shape)
    return array.shape == shape and (expected or shape != _keras_shape(tensor))


def _keras_shape(tensor: Tensor) -> tuple[int, ...]:
    """Return a kernel's shape in Keras: (h, w, in, out) or (in, out).

    >>> _keras_shape(torch.empty(24, 3, 5, 5))
    (5, 5, 3, 24)
    """
    out, inputs, *rest = tensor.shape
    return (*rest, inputs, out)


def load_keras_weights(network: nn.Module, path: Path) -> str:
    """Load a Keras file into `network`, and return one line on what was loaded.

    The file holds a whole model or only weights. Layers are paired in order. Kernels change from
    (h, w, in, out) to torch's (out, in, h, w), and the first dense layer's rows from Keras' flatten
    order (h, w, c) to torch's (c, h, w).

    Raises:
        InputError: the file is not Keras', or does not fit; names the layer that differs.
    """
    model = read_keras_apart(path, None, False)
    groups = _groups(model)
    kind = type(network).__name__
    modules = [m for m in network.modules() if isinstance(m, WithWeights)]
    if len(groups) != len(modules):
        names = ", ".join(layer.name for layer, _ in groups)
        raise InputError(
            f"{path}: has {len(groups)} layers with weights ({names!s:.500}), {kind} has "
            f"{len(modules)}; set the model of the file's training, or model=keras for any"
        )
    first = _channels_first(model)
    if first is None:
        first = any(
            _is_out_in_first(arrays[0], module.weight, False)
            for (_, arrays), module in zip(groups, modules, strict=True)
            if isinstance(module, nn.Conv2d)
        )
    flattens_last = any(
        layer.kind == "Flatten" and layer.config.get("data_format") == "channels_first"
        for layer in model.layers
    )
    tensors: list[Tensor] = []
    values: list[np.ndarray] = []
    channels = None  # of the last convolution; None after the first dense layer
    for number, ((layer, arrays), module) in enumerate(zip(groups, modules, strict=True), start=1):
        named = _tensors(module)
        try:
            arranged = _arranged(arrays, named, layer.kind, model, first)
        except MisfitError as error:
            follows_view = isinstance(module, nn.Conv1d) or (error.follows_input and channels)
            fix = "set model.width, or the model of the file's training"
            if follows_view:
                fix = "set model.size and data.crop to the file's input"
            elif number == 1:
                fix = "set model.colour, or the model of the file's training"
            raise InputError(
                f"{path}: layer {number} of {len(modules)}, {layer.name}, does not fit {kind}: "
                f"{error}; {fix}{_input(model)}"
            ) from None
        if not isinstance(module, nn.Linear):
            channels = module.out_channels
        elif channels is not None:
            if not first or flattens_last:
                arranged[0] = _channels_first_inputs(arranged[0], channels)
            channels = None
        tensors += [tensor for _, tensor in named]
        values += arranged
    _copy(tensors, values)
    doubt = backend_doubt(model, first)
    return f"{len(modules)} layers from {path} (Keras {model.version}{doubt}){_input(model)}"


def backend_doubt(model: KerasModel, first: bool) -> str:
    """Return a text on a file that does not tell its backend; empty if it does.

    Keras before 1.2 did not save it. Kernels of Theano, its default, must be flipped.

    Args:
        model: file's model.
        first: whether the images are channels first, as Theano's were.
    """
    doubt = "; no backend in the file, read as TensorFlow's, not Theano's"
    return doubt if first and not model.backend else ""


def _groups(model: KerasModel) -> list[tuple[KerasLayer, list[np.ndarray]]]:
    """Return each kernel with its bias; a nested model's layers may stand in one group."""
    groups: list[tuple[KerasLayer, list[np.ndarray]]] = []
    for layer in model.layers:
        for array in layer.arrays:
            if array.ndim == 1 and groups and groups[-1][0] is layer:
                groups[-1][1].append(array)
            else:
                groups.append((layer, [array]))
    return groups


def _channels_first_inputs(kernel: np.ndarray, channels: int) -> np.ndarray:
    """Return a kernel [out, in] whose inputs are (channels, pixels), not (pixels, channels)."""
    size = kernel.shape[1] // channels * channels  # after them, the speed of `nvidia_speed`
    pixels = kernel[:, :size].reshape(len(kernel), -1, channels).transpose(0, 2, 1)
    return np.concatenate([pixels.reshape(len(kernel), size), kernel[:, size:]], axis=1)


def _channels_first(model: KerasModel) -> bool | None:
    """Return whether the model's images are channels first; None if the file does not tell."""
    for layer in model.layers:
        order = layer.config.get("data_format") or layer.config.get("dim_ordering")
        if layer.kind != "Flatten" and str(order) in ORDERS:
            return ORDERS[str(order)] == "channels_first"
    return None


def _input(model: KerasModel) -> str:
    """Return a text on the model's input, such as `; its input is 160 x 320 x 3`."""
    return f"; its input is {by(model.input_shape):.100}" if model.input_shape else ""

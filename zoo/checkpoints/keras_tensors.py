"""Copy a Keras layer's arrays into the module that was built from its spec."""

import numpy as np
import torch
from torch import Tensor, nn

from zoo.checkpoints.keras_model import KerasLayer, KerasModel
from zoo.models.value_layers import BatchNorm, PReLU

CONVOLUTIONS = ("Conv2D", "Conv1D")  # whose kernels Theano mirrors


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
            wanted = _keras_shape(name, place, first)
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


def _keras_shape(name: str, place: Tensor, first: bool) -> tuple[int, ...]:
    shape = tuple(place.shape)
    if name == "alpha" and len(shape) == 3 and not first:
        return (*shape[1:], shape[0])
    if len(shape) == 4:
        return (*shape[2:], shape[1], shape[0])
    return shape[::-1]


def by(shape: tuple[int, ...] | list[int]) -> str:
    """Return a shape as text, such as `5 x 5 x 3 x 24`."""
    return " x ".join(map(str, shape)) or "a number"

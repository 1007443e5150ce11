"""Build the modules of `zoo.models.sequential` from specs; one function for each kind of layer.

A function takes a spec, the input's shape of one sample in Keras' order of axes, and whether that
order is channels first. It returns the module and the output's shape.
"""

import math
from collections.abc import Callable
from functools import partial

import torch
from torch import nn

from zoo.models.image_layers import (
    RESIZE_METHODS,
    Crop,
    Gray,
    InKerasOrder,
    OnAxis,
    Permute,
    Reshape,
    Resize,
)
from zoo.models.layers import Dropout
from zoo.models.value_layers import (
    ACTIVATIONS,
    BatchNorm,
    GaussianNoise,
    GeneralReLU,
    PReLU,
    Rescaling,
    Select,
)
from zoo.models.window_builders import (
    Builder,
    Built,
    LayerSpec,
    Shape,
    activated,
    by,
    conv1d,
    conv2d,
    depthwise,
    global_pool,
    image_of,
    pool,
    pool1d,
    shape_of,
)


def _dense(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    units = spec.whole("units", most=10_000_000)
    module: nn.Module = nn.Linear(shape[-1], units, bias=spec.flag("use_bias", True))
    if len(shape) == 3 and not first:  # on every pixel; channels first, it is on the columns
        module = InKerasOrder(module)
    return activated(module, spec), (*shape[:-1], units)


def _flatten(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    own = spec.values.get("data_format", "channels_last")
    # With channels first, Keras 2.2 and later put the channels last here.
    last = not first or own == "channels_first"
    module = nn.Flatten(1)
    return InKerasOrder(module) if len(shape) == 3 and last else module, (math.prod(shape),)


def _reshape(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    target = spec.wholes("target_shape", least=-1, most=2**26)
    count, known = math.prod(shape), math.prod(one for one in target if one != -1)
    if target.count(-1) == 1 and known > 0 and count % known == 0:
        target = [count // known if one == -1 else one for one in target]
    if math.prod(target) != count or min(target, default=0) < 1 or len(target) > 3:
        raise spec.wrong("target_shape", f"does not hold the {count:,} values of {by(shape)}")
    module = Reshape(tuple(target))
    return module if first else InKerasOrder(module), tuple(target)


def _permute(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    axes = spec.wholes("dims", most=3)
    if sorted(axes) != list(range(1, len(shape) + 1)):
        raise spec.wrong("dims", f"does not order the axes 1..{len(shape)}")
    module = Permute(tuple(axes))
    return module if first else InKerasOrder(module), tuple(shape[axis - 1] for axis in axes)


def _batch_norm(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    axis = spec.whole("axis", -1, least=-3, most=3)
    axis = axis if axis > 0 else len(shape) + 1 + axis
    if not 1 <= axis <= len(shape):
        raise spec.wrong("axis", f"is not an axis of {by(shape)}")
    module: nn.Module = BatchNorm(
        shape[axis - 1], spec.number("epsilon", 1e-3), spec.number("momentum", 0.99),
        spec.flag("center", True), spec.flag("scale", True),
    )  # fmt: skip
    if len(shape) == 3 and not first:
        axis = axis % 3 + 1  # of rows, columns, channels in torch's order
    return module if axis == 1 else OnAxis(module, axis), shape


def _prelu(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    shared = spec.wholes("shared_axes", [], most=3)
    sizes = [1 if axis in shared else size for axis, size in enumerate(shape, start=1)]
    if len(shape) == 3 and not first:
        sizes = [sizes[2], *sizes[:2]]
    return PReLU(tuple(sizes)), shape


def _relu(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    most = spec.number("max_value") if spec.values.get("max_value") is not None else None
    slope, threshold = spec.number("negative_slope", 0), spec.number("threshold", 0)
    if most is None and not slope and not threshold:
        return nn.ReLU(), shape
    return GeneralReLU(slope, threshold, most), shape


def _thresholded(spec: LayerSpec) -> nn.Module:
    return nn.Threshold(spec.number("theta", 1.0), 0.0)


def _crop(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    rows, columns, channels = image_of(spec, shape, first)
    top, bottom, left, right = spec.edges("cropping")
    rows, columns = rows - top - bottom, columns - left - right
    module = Crop((top, bottom, left, right), (rows, columns))
    return module, shape_of(rows, columns, channels, first)


def _zero_padding(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    rows, columns, channels = image_of(spec, shape, first)
    top, bottom, left, right = spec.edges("padding")
    out = shape_of(rows + top + bottom, columns + left + right, channels, first)
    return nn.ZeroPad2d((left, right, top, bottom)), out


def _resize(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    rows, columns, channels = image_of(spec, shape, first)
    size = spec.pair("size")
    module = Resize((rows, columns), size, spec.word("method", RESIZE_METHODS, "linear"))
    return module, shape_of(*size, channels, first)


def _rescaling(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    channels = shape[0] if first else shape[-1]
    scale, offset = spec.numbers("scale"), spec.numbers("offset", 0.0)
    tensors = []
    for key, numbers in (("scale", scale), ("offset", offset)):
        if len(numbers) not in (1, channels):
            raise spec.wrong(key, f"is not one number or {channels}")
        across = len(shape) == 3 and len(numbers) > 1
        tensors.append(torch.tensor(numbers)[:, None, None] if across else torch.tensor(numbers))
    return Rescaling(*tensors), shape


def _gray(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    rows, columns, channels = image_of(spec, shape, first)
    weights = spec.numbers("weights")
    if len(weights) != channels:
        raise spec.wrong("weights", f"is not {channels} numbers")
    return Gray(weights), shape_of(rows, columns, 1, first)


def _select(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    columns = spec.wholes("columns", least=0)
    if len(shape) != 1 or not columns or max(columns) >= shape[0]:
        raise spec.wrong("columns", f"are not columns of {by(shape)}")
    return Select(columns), (len(columns),)


def _dropout(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    rate = spec.share("rate")
    spatial = spec.values["layer"].startswith("Spatial") and len(shape) == 3
    return nn.Dropout2d(rate) if spatial else Dropout(rate), shape


def _noise(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    if spec.values["layer"] == "GaussianNoise":
        return GaussianNoise(spec.number("stddev"), multiplies=False), shape
    rate = spec.share("rate")
    return GaussianNoise(math.sqrt(rate / (1 - rate)), multiplies=True), shape


def _elementwise(
    make: Callable[[LayerSpec], nn.Module], spec: LayerSpec, shape: Shape, _: bool
) -> Built:
    return make(spec), shape


def _activation(spec: LayerSpec) -> nn.Module:
    return ACTIVATIONS[spec.word("activation", list(ACTIVATIONS))]()


BUILDERS: dict[str, Builder] = {
    "Conv2D": conv2d,
    "SeparableConv2D": depthwise,
    "DepthwiseConv2D": depthwise,
    "Conv1D": conv1d,
    "Dense": _dense,
    "Flatten": _flatten,
    "Reshape": _reshape,
    "Permute": _permute,
    "MaxPooling2D": pool,
    "AveragePooling2D": pool,
    "MaxPooling1D": pool1d,
    "AveragePooling1D": pool1d,
    "GlobalAveragePooling2D": global_pool,
    "GlobalMaxPooling2D": global_pool,
    "BatchNormalization": _batch_norm,
    "Activation": partial(_elementwise, _activation),
    "ELU": partial(_elementwise, lambda spec: nn.ELU(spec.number("alpha", 1.0))),
    "LeakyReLU": partial(_elementwise, lambda spec: nn.LeakyReLU(spec.number("alpha", 0.3))),
    "ThresholdedReLU": partial(_elementwise, _thresholded),
    "PReLU": _prelu,
    "ReLU": _relu,
    "Cropping2D": _crop,
    "ZeroPadding2D": _zero_padding,
    "Resize": _resize,
    "Rescaling": _rescaling,
    "Gray": _gray,
    "Select": _select,
    "Dropout": _dropout,
    "SpatialDropout2D": _dropout,
    "GaussianNoise": _noise,
    "GaussianDropout": _noise,
}

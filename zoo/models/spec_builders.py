"""Build the modules of `zoo.models.sequential` from specs; one function for each kind of layer.

A function takes a spec, the input's shape of one sample in Keras' order of axes, and whether that
order is channels first. It returns the module and the output's shape.
"""

import math
from collections.abc import Callable
from functools import partial

import torch
from torch import nn

from zoo.models.layer_spec import LayerSpec
from zoo.models.layers import Dropout
from zoo.models.sequential_layers import (
    ACTIVATIONS,
    RESIZE_METHODS,
    BatchNorm,
    Crop,
    GaussianNoise,
    GeneralReLU,
    GlobalPool,
    Gray,
    InKerasOrder,
    OnAxis,
    OverRows,
    PaddedAvgPool2d,
    PaddedConv2d,
    PaddedMaxPool2d,
    Pads,
    Permute,
    PReLU,
    Rescaling,
    Reshape,
    Resize,
    Select,
)

Shape = tuple[int, ...]
Built = tuple[nn.Module, Shape]
Builder = Callable[[LayerSpec, Shape, bool], Built]
Pair = tuple[int, int]


def _image(spec: LayerSpec, shape: Shape, first: bool) -> tuple[int, int, int]:
    """Return rows, columns and channels of the input."""
    if len(shape) != 3:
        raise ValueError(f"{spec.label}: needs images, not values of shape {_by(shape)}")
    own = spec.values.get("data_format", "channels_first" if first else "channels_last")
    if own != ("channels_first" if first else "channels_last"):
        raise ValueError(f"{spec.label}: has data_format={own!r:.40}, unlike the other layers")
    return (shape[1], shape[2], shape[0]) if first else (shape[0], shape[1], shape[2])


def _shape(rows: int, columns: int, channels: int, first: bool) -> Shape:
    return (channels, rows, columns) if first else (rows, columns, channels)


def _by(shape: Shape) -> str:
    return " x ".join(map(str, shape)) or "one number"


def _window(
    spec: LayerSpec, size: Pair, kernel: Pair, stride: Pair, dilation: Pair = (1, 1)
) -> tuple[Pads, Pair]:
    """Return a window's padding as TensorFlow pads, and the rows and columns of the output."""
    padding = spec.word("padding", ("valid", "same"), "valid")
    pads, out = [], []
    for length, side, step, gap in zip(size, kernel, stride, dilation, strict=True):
        side = (side - 1) * gap + 1
        if padding == "same":
            count = -(-length // step)
            total = max((count - 1) * step + side - length, 0)
        else:
            count, total = (length - side) // step + 1, 0
        if count < 1:
            raise ValueError(
                f"{spec.label}: its window of {side} pixels does not fit the input of "
                f"{size[0]} x {size[1]}; set the view (data.crop, model.size) of the training"
            )
        out.append(count)
        pads = [total // 2, total - total // 2, *pads]  # F.pad takes the width first
    return (pads[0], pads[1], pads[2], pads[3]), (out[0], out[1])


def _convolution(
    channels: int, filters: int, kernel: Pair, stride: Pair, pads: Pads, **more: object
) -> nn.Conv2d:
    left, right, top, bottom = pads
    if left == right and top == bottom:
        return nn.Conv2d(channels, filters, kernel, stride, (top, left), **more)
    layer = PaddedConv2d(channels, filters, kernel, stride, **more)
    layer.pads = pads
    return layer


def _activated(module: nn.Module, spec: LayerSpec) -> nn.Module:
    name = spec.word("activation", list(ACTIVATIONS), "linear")
    return module if name == "linear" else nn.Sequential(module, ACTIVATIONS[name]())


def _conv2d(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    rows, columns, channels = _image(spec, shape, first)
    filters, groups = spec.whole("filters"), spec.whole("groups", 1)
    kernel, stride = spec.pair("kernel_size"), spec.pair("strides", [1, 1])
    dilation = spec.pair("dilation_rate", [1, 1])
    if channels % groups or filters % groups:
        raise spec.wrong("groups", f"does not divide {channels} channels and {filters} filters")
    pads, out = _window(spec, (rows, columns), kernel, stride, dilation)
    bias = spec.flag("use_bias", True)
    module = _convolution(
        channels, filters, kernel, stride, pads, dilation=dilation, groups=groups, bias=bias
    )
    return _activated(module, spec), _shape(*out, filters, first)


def _depthwise(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    rows, columns, channels = _image(spec, shape, first)
    separable = spec.values["layer"] == "SeparableConv2D"
    filters = channels * spec.whole("depth_multiplier", 1)
    kernel, stride = spec.pair("kernel_size"), spec.pair("strides", [1, 1])
    dilation = spec.pair("dilation_rate", [1, 1])
    pads, out = _window(spec, (rows, columns), kernel, stride, dilation)
    bias = spec.flag("use_bias", True)
    module: nn.Module = _convolution(
        channels, filters, kernel, stride, pads, dilation=dilation, groups=channels,
        bias=bias and not separable,
    )  # fmt: skip
    if separable:
        inner, filters = filters, spec.whole("filters")
        module = nn.Sequential(module, nn.Conv2d(inner, filters, 1, bias=bias))
    return _activated(module, spec), _shape(*out, filters, first)


def _conv1d(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    steps, channels = _sequence(spec, shape)
    filters, size = spec.whole("filters"), spec.whole("kernel_size", most=4096)
    stride, gap = spec.whole("strides", 1), spec.whole("dilation_rate", 1)
    pads, out = _window(spec, (1, steps), (1, size), (1, stride), (1, gap))
    module = _convolution(
        channels, filters, (1, size), (1, stride), pads, dilation=(1, gap),
        bias=spec.flag("use_bias", True),
    )  # fmt: skip
    return _activated(OverRows(module), spec), (out[1], filters)


def _sequence(spec: LayerSpec, shape: Shape) -> Pair:
    if len(shape) != 2:
        raise ValueError(f"{spec.label}: needs steps x channels, not a shape of {_by(shape)}")
    return shape[0], shape[1]


def _dense(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    units = spec.whole("units", most=10_000_000)
    module: nn.Module = nn.Linear(shape[-1], units, bias=spec.flag("use_bias", True))
    if len(shape) == 3 and not first:  # on every pixel; channels first, it is on the columns
        module = InKerasOrder(module)
    return _activated(module, spec), (*shape[:-1], units)


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
        raise spec.wrong("target_shape", f"does not hold the {count:,} values of {_by(shape)}")
    module = Reshape(tuple(target))
    return module if first else InKerasOrder(module), tuple(target)


def _permute(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    axes = spec.wholes("dims", most=3)
    if sorted(axes) != list(range(1, len(shape) + 1)):
        raise spec.wrong("dims", f"does not order the axes 1..{len(shape)}")
    module = Permute(tuple(axes))
    return module if first else InKerasOrder(module), tuple(shape[axis - 1] for axis in axes)


def _pool(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    rows, columns, channels = _image(spec, shape, first)
    size = spec.pair("pool_size", [2, 2])
    stride = spec.pair("strides", list(size))
    pads, out = _window(spec, (rows, columns), size, stride)
    module = _pooling(spec.values["layer"].startswith("Max"), size, stride, pads, (rows, columns))
    return module, _shape(*out, channels, first)


def _pooling(maximum: bool, size: Pair, stride: Pair, pads: Pads, shape: Pair) -> nn.Module:
    if not maximum:
        return (
            PaddedAvgPool2d(size, stride, pads, shape) if any(pads) else nn.AvgPool2d(size, stride)
        )
    if not any(pads):
        return nn.MaxPool2d(size, stride)
    module = PaddedMaxPool2d(size, stride)
    module.pads = pads
    return module


def _pool1d(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    steps, channels = _sequence(spec, shape)
    size = spec.whole("pool_size", 2)
    stride = spec.whole("strides", size)
    pads, out = _window(spec, (1, steps), (1, size), (1, stride))
    maximum = spec.values["layer"].startswith("Max")
    module = _pooling(maximum, (1, size), (1, stride), pads, (1, steps))
    return OverRows(module), (out[1], channels)


def _global_pool(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    *_, channels = _image(spec, shape, first)
    keep = spec.flag("keepdims", False)
    module = GlobalPool("Max" in spec.values["layer"], keep)
    return module, _shape(1, 1, channels, first) if keep else (channels,)


def _batch_norm(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    axis = spec.whole("axis", -1, least=-3, most=3)
    axis = axis if axis > 0 else len(shape) + 1 + axis
    if not 1 <= axis <= len(shape):
        raise spec.wrong("axis", f"is not an axis of {_by(shape)}")
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
    rows, columns, channels = _image(spec, shape, first)
    top, bottom, left, right = spec.edges("cropping")
    rows, columns = rows - top - bottom, columns - left - right
    module = Crop((top, bottom, left, right), (rows, columns))
    return module, _shape(rows, columns, channels, first)


def _zero_padding(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    rows, columns, channels = _image(spec, shape, first)
    top, bottom, left, right = spec.edges("padding")
    out = _shape(rows + top + bottom, columns + left + right, channels, first)
    return nn.ZeroPad2d((left, right, top, bottom)), out


def _resize(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    rows, columns, channels = _image(spec, shape, first)
    size = spec.pair("size")
    module = Resize((rows, columns), size, spec.word("method", RESIZE_METHODS, "linear"))
    return module, _shape(*size, channels, first)


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
    rows, columns, channels = _image(spec, shape, first)
    weights = spec.numbers("weights")
    if len(weights) != channels:
        raise spec.wrong("weights", f"is not {channels} numbers")
    return Gray(weights), _shape(rows, columns, 1, first)


def _select(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    columns = spec.wholes("columns", least=0)
    if len(shape) != 1 or not columns or max(columns) >= shape[0]:
        raise spec.wrong("columns", f"are not columns of {_by(shape)}")
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
    "Conv2D": _conv2d,
    "SeparableConv2D": _depthwise,
    "DepthwiseConv2D": _depthwise,
    "Conv1D": _conv1d,
    "Dense": _dense,
    "Flatten": _flatten,
    "Reshape": _reshape,
    "Permute": _permute,
    "MaxPooling2D": _pool,
    "AveragePooling2D": _pool,
    "MaxPooling1D": _pool1d,
    "AveragePooling1D": _pool1d,
    "GlobalAveragePooling2D": _global_pool,
    "GlobalMaxPooling2D": _global_pool,
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

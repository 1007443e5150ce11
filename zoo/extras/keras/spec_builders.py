"""Build the modules of `LayerChain` from specs; one function for each kind of layer.

A function takes a spec, the input's shape of one sample in Keras' order of axes, and whether that
order is channels first. It returns the module and the output's shape.
"""

import math
from collections.abc import Callable

import torch
from torch import Tensor, nn

from zoo.extras.keras.keras_modules import (
    ACTIVATIONS,
    RESIZE_METHODS,
    BatchNorm,
    GaussianNoise,
    Lambda,
    OnAxis,
    PaddedConv2d,
    Pads,
    PReLU,
    Resize,
)
from zoo.extras.keras.layer_spec import LayerSpec, Pair, Shape, by
from zoo.models.layers import Crop, Dropout, InKerasOrder, Unbin

Built = tuple[nn.Module, Shape]
Builder = Callable[[LayerSpec, Shape, bool], Built]
# TensorFlow's `same` and Theano's, which pads half a window in front, also with a stride.
PADDINGS = ("valid", "same", "same_theano")


def _image_of(spec: LayerSpec, shape: Shape, first: bool) -> tuple[int, int, int]:
    """Return rows, columns and channels of the input."""
    if len(shape) != 3:
        raise ValueError(f"{spec.label}: needs images, not values of shape {by(shape)}")
    order = "channels_first" if first else "channels_last"
    saved = spec.values.get("data_format", order)
    if saved != order:
        raise ValueError(f"{spec.label}: has data_format={saved!r:.40}, unlike the other layers")
    return (shape[1], shape[2], shape[0]) if first else (shape[0], shape[1], shape[2])


def _shape_of(rows: int, columns: int, channels: int, first: bool) -> Shape:
    return (channels, rows, columns) if first else (rows, columns, channels)


def _axis(spec: LayerSpec, shape: Shape, first: bool) -> tuple[int, int]:
    """Return a layer's axis, by default the last one of Keras, in Keras' and in torch's order."""
    axis = spec.whole("axis", -1, least=-3, most=3)
    axis = axis if axis > 0 else len(shape) + 1 + axis
    if not 1 <= axis <= len(shape):
        raise spec.wrong("axis", f"is not an axis of {by(shape)}")
    return axis, axis % 3 + 1 if len(shape) == 3 and not first else axis


def _activation(spec: LayerSpec, shape: Shape, first: bool, default: str | None = None) -> Built:
    name = spec.word("activation", list(ACTIVATIONS), default)
    if name == "softmax":
        return nn.Softmax(_axis(spec, shape, first)[1]), shape
    return ACTIVATIONS[name](), shape


def _activated(module: nn.Module, spec: LayerSpec, shape: Shape, first: bool) -> Built:
    """Return a module with the activation of its spec after it, and its output's shape."""
    activation, shape = _activation(spec, shape, first, "linear")
    is_linear = isinstance(activation, nn.Identity)
    return module if is_linear else nn.Sequential(module, activation), shape


def _window(
    spec: LayerSpec, size: Pair, kernel: Pair, stride: Pair, dilation: Pair = (1, 1)
) -> tuple[Pads, Pair]:
    """Return a window's padding as TensorFlow pads, and the rows and columns of the output."""
    padding = spec.word("padding", PADDINGS, "valid")
    pads: list[int] = []
    out = []
    for length, side, step, gap in zip(size, kernel, stride, dilation, strict=True):
        side = (side - 1) * gap + 1
        count, before, after = (length - side) // step + 1, 0, 0
        if padding != "valid":
            count = -(-length // step)
            total = max((count - 1) * step + side - length, 0)
            before = total // 2 if padding == "same" else side // 2
            after = max(total - before, 0)
        if count < 1:
            raise ValueError(
                f"{spec.label}: its window of {side} pixels does not fit the input of "
                f"{size[0]} x {size[1]}; set the view (data.crop, model.size) of the training"
            )
        out.append(count)
        pads = [before, after, *pads]  # F.pad takes the width first
    return (pads[0], pads[1], pads[2], pads[3]), (out[0], out[1])


def _convolution(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    rows, columns, channels = _image_of(spec, shape, first)
    kernel, stride = spec.pair("kernel_size"), spec.pair("strides", (1, 1))
    dilation, bias = spec.pair("dilation_rate", (1, 1)), spec.flag("use_bias", True)
    separable = spec.layer == "SeparableConv2D"
    if separable or spec.layer == "DepthwiseConv2D":
        groups, filters = channels, channels * spec.whole("depth_multiplier", 1)
    else:
        groups, filters = spec.whole("groups", 1), spec.whole("filters")
        if channels % groups or filters % groups:
            raise spec.wrong("groups", f"does not divide {channels} channels and {filters} filters")
    pads, out = _window(spec, (rows, columns), kernel, stride, dilation)
    left, right, top, bottom = pads
    even = left == right and top == bottom
    edges = (top, left) if even else (0, 0)
    sizes = channels, filters, kernel, stride, edges, dilation, groups, bias and not separable
    module: nn.Module = nn.Conv2d(*sizes) if even else PaddedConv2d(pads, *sizes)
    if separable:
        inner, filters = filters, spec.whole("filters")
        module = nn.Sequential(module, nn.Conv2d(inner, filters, 1, bias=bias))
    return _activated(module, spec, _shape_of(*out, filters, first), first)


def _pool(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    rows, columns, channels = _image_of(spec, shape, first)
    size = spec.pair("pool_size", (2, 2))
    stride = spec.pair("strides", size)
    pads, out = _window(spec, (rows, columns), size, stride)
    is_max = spec.layer.startswith("Max")
    module: nn.Module = nn.MaxPool2d(size, stride) if is_max else nn.AvgPool2d(size, stride)
    if any(pads):
        pad = nn.ZeroPad2d(pads)
        if is_max:
            pad.value = float("-inf")  # never the maximum
            module = nn.Sequential(pad, module)
        else:  # padding does not count in the mean
            shares = module(pad(torch.ones(1, 1, rows, columns)))
            module = nn.Sequential(pad, module, Lambda(lambda means: means / shares.to(means)))
    return module, _shape_of(*out, channels, first)


def _global_pool(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    *_, channels = _image_of(spec, shape, first)
    pool = nn.AdaptiveMaxPool2d(1) if "Max" in spec.layer else nn.AdaptiveAvgPool2d(1)
    if spec.flag("keepdims", False):
        return pool, _shape_of(1, 1, channels, first)
    return nn.Sequential(pool, nn.Flatten()), (channels,)


def _dense(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    units = spec.whole("units", most=10_000_000)
    module: nn.Module = nn.Linear(shape[-1], units, bias=spec.flag("use_bias", True))
    if len(shape) == 3 and not first:  # on every pixel; channels first, it is on the columns
        module = InKerasOrder(module)
    return _activated(module, spec, (*shape[:-1], units), first)


def _flatten(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    order = spec.values.get("data_format", "channels_last")
    # With channels first, Keras 2.2 and later put the channels last here.
    last = not first or order == "channels_first"
    module = nn.Flatten(1)
    return InKerasOrder(module) if len(shape) == 3 and last else module, (math.prod(shape),)


def _reshape(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    target = spec.wholes("target_shape", least=-1, most=2**26)
    count, product = math.prod(shape), math.prod(side for side in target if side != -1)
    if target.count(-1) == 1 and product > 0 and count % product == 0:
        target = [count // product if side == -1 else side for side in target]
    if math.prod(target) != count or min(target, default=0) < 1 or len(target) > 3:
        raise spec.wrong("target_shape", f"does not hold the {count:,} values of {by(shape)}")
    module = nn.Sequential(nn.Flatten(), nn.Unflatten(1, tuple(target)))
    return module if first else InKerasOrder(module), tuple(target)


def _permute(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    axes = spec.wholes("dims", most=3)
    if sorted(axes) != list(range(1, len(shape) + 1)):
        raise spec.wrong("dims", f"does not order the axes 1..{len(shape)}")
    module: nn.Module = Lambda(lambda values: values.permute(0, *axes))
    return module if first else InKerasOrder(module), tuple(shape[axis - 1] for axis in axes)


def _batch_norm(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    axis, torch_axis = _axis(spec, shape, first)
    module: nn.Module = BatchNorm(
        shape[axis - 1], spec.number("epsilon", 1e-3), spec.number("momentum", 0.99),
        spec.flag("center", True), spec.flag("scale", True),
    )  # fmt: skip
    return module if torch_axis == 1 else OnAxis(module, torch_axis), shape


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

    def relu(values: Tensor) -> Tensor:
        out = torch.where(values >= threshold, values, slope * (values - threshold))
        return out if most is None else torch.where(values >= most, most, out)

    return Lambda(relu), shape


def _crop(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    rows, columns, channels = _image_of(spec, shape, first)
    top, bottom, left, right = spec.edges("cropping")
    rows, columns = rows - top - bottom, columns - left - right
    module = Crop((top, bottom, left, right), (rows, columns))
    return module, _shape_of(rows, columns, channels, first)


def _zero_padding(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    rows, columns, channels = _image_of(spec, shape, first)
    top, bottom, left, right = spec.edges("padding")
    out = _shape_of(rows + top + bottom, columns + left + right, channels, first)
    return nn.ZeroPad2d((left, right, top, bottom)), out


def _resize(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    rows, columns, channels = _image_of(spec, shape, first)
    size = spec.pair("size")
    module = Resize((rows, columns), size, spec.word("method", RESIZE_METHODS, "linear"))
    return module, _shape_of(*size, channels, first)


def _rescaling(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    channels = shape[0] if first else shape[-1]
    scale, offset = spec.numbers("scale"), spec.numbers("offset", 0.0)
    tensors = []
    for key, numbers in (("scale", scale), ("offset", offset)):
        if len(numbers) not in (1, channels):
            raise spec.wrong(key, f"is not one number or {channels}")
        across = len(shape) == 3 and len(numbers) > 1
        tensors.append(torch.tensor(numbers)[:, None, None] if across else torch.tensor(numbers))
    factors, terms = tensors
    return Lambda(lambda values: values * factors.to(values) + terms.to(values)), shape


def _gray(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    rows, columns, channels = _image_of(spec, shape, first)
    weights = spec.numbers("weights")
    if len(weights) != channels:
        raise spec.wrong("weights", f"is not {channels} numbers")
    factors = torch.tensor(weights)[:, None, None]
    module = Lambda(lambda images: (images * factors.to(images)).sum(1, keepdim=True))
    return module, _shape_of(rows, columns, 1, first)


def _select(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    columns = spec.wholes("columns", least=0)
    if len(shape) != 1 or not columns or max(columns) >= shape[0]:
        raise spec.wrong("columns", f"are not columns of {by(shape)}")
    module = Lambda(lambda values: torch.stack([values[:, column] for column in columns], 1))
    return module, (len(columns),)


def _unbin(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    bins, lows, steps = spec.wholes("bins"), spec.numbers("lows"), spec.numbers("steps")
    if shape != (sum(bins),) or not len(bins) == len(lows) == len(steps):
        raise spec.wrong("bins", f"with lows and steps are not groups of {by(shape)}")
    return Unbin(bins, lows, steps), (len(bins),)


def _dropout(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    rate = spec.share("rate")
    spatial = spec.layer.startswith("Spatial") and len(shape) == 3
    return nn.Dropout2d(rate) if spatial else Dropout(rate), shape


def _elementwise(make: Callable[[LayerSpec], nn.Module]) -> Builder:
    return lambda spec, shape, _: (make(spec), shape)


BUILDERS: dict[str, Builder] = {
    "Conv2D": _convolution,
    "SeparableConv2D": _convolution,
    "DepthwiseConv2D": _convolution,
    "Dense": _dense,
    "Flatten": _flatten,
    "Reshape": _reshape,
    "Permute": _permute,
    "MaxPooling2D": _pool,
    "AveragePooling2D": _pool,
    "GlobalAveragePooling2D": _global_pool,
    "GlobalMaxPooling2D": _global_pool,
    "BatchNormalization": _batch_norm,
    "Activation": _activation,
    "ELU": _elementwise(lambda spec: nn.ELU(spec.number("alpha", 1.0))),
    "LeakyReLU": _elementwise(lambda spec: nn.LeakyReLU(spec.number("alpha", 0.3))),
    "PReLU": _prelu,
    "ReLU": _relu,
    "Cropping2D": _crop,
    "ZeroPadding2D": _zero_padding,
    "Resize": _resize,
    "Rescaling": _rescaling,
    "Gray": _gray,
    "Select": _select,
    "Unbin": _unbin,
    "Dropout": _dropout,
    "SpatialDropout2D": _dropout,
    "GaussianNoise": _elementwise(lambda spec: GaussianNoise(spec.number("stddev"))),
}

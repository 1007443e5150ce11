"""Build convolutions and poolings of `zoo.models.sequential` from specs; see `spec_builders`."""

from collections.abc import Callable

from torch import nn

from zoo.models.image_layers import (
    GlobalPool,
    OverRows,
    PaddedAvgPool2d,
    PaddedConv2d,
    PaddedMaxPool2d,
    Pads,
)
from zoo.models.layer_spec import LayerSpec
from zoo.models.value_layers import ACTIVATIONS

Shape = tuple[int, ...]


Built = tuple[nn.Module, Shape]


Builder = Callable[[LayerSpec, Shape, bool], Built]


Pair = tuple[int, int]


# TensorFlow's `same` and Theano's, which pads half a window in front, also with a stride.
PADDINGS = ("valid", "same", "same_theano")


def image_of(spec: LayerSpec, shape: Shape, first: bool) -> tuple[int, int, int]:
    """Return rows, columns and channels of the input."""
    if len(shape) != 3:
        raise ValueError(f"{spec.label}: needs images, not values of shape {by(shape)}")
    own = spec.values.get("data_format", "channels_first" if first else "channels_last")
    if own != ("channels_first" if first else "channels_last"):
        raise ValueError(f"{spec.label}: has data_format={own!r:.40}, unlike the other layers")
    return (shape[1], shape[2], shape[0]) if first else (shape[0], shape[1], shape[2])


def shape_of(rows: int, columns: int, channels: int, first: bool) -> Shape:
    """Return a shape in Keras' order of axes."""
    return (channels, rows, columns) if first else (rows, columns, channels)


def by(shape: Shape) -> str:
    """Return a shape as text, such as `66 x 200 x 3`."""
    return " x ".join(map(str, shape)) or "one number"


def activated(module: nn.Module, spec: LayerSpec) -> nn.Module:
    """Return a module with the activation of its spec after it."""
    name = spec.word("activation", list(ACTIVATIONS), "linear")
    return module if name == "linear" else nn.Sequential(module, ACTIVATIONS[name]())


def _window(
    spec: LayerSpec, size: Pair, kernel: Pair, stride: Pair, dilation: Pair = (1, 1)
) -> tuple[Pads, Pair]:
    """Return a window's padding as TensorFlow pads, and the rows and columns of the output."""
    padding = spec.word("padding", PADDINGS, "valid")
    pads, out = [], []
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


def _convolution(
    channels: int, filters: int, kernel: Pair, stride: Pair, pads: Pads, **more: object
) -> nn.Conv2d:
    left, right, top, bottom = pads
    if left == right and top == bottom:
        return nn.Conv2d(channels, filters, kernel, stride, (top, left), **more)
    layer = PaddedConv2d(channels, filters, kernel, stride, **more)
    layer.pads = pads
    return layer


def conv2d(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    """Build `Conv2D`."""
    rows, columns, channels = image_of(spec, shape, first)
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
    return activated(module, spec), shape_of(*out, filters, first)


def depthwise(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    """Build `DepthwiseConv2D` or `SeparableConv2D`."""
    rows, columns, channels = image_of(spec, shape, first)
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
    return activated(module, spec), shape_of(*out, filters, first)


def conv1d(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    """Build `Conv1D`."""
    steps, channels = _sequence(spec, shape)
    filters, size = spec.whole("filters"), spec.whole("kernel_size", most=4096)
    stride, gap = spec.whole("strides", 1), spec.whole("dilation_rate", 1)
    pads, out = _window(spec, (1, steps), (1, size), (1, stride), (1, gap))
    module = _convolution(
        channels, filters, (1, size), (1, stride), pads, dilation=(1, gap),
        bias=spec.flag("use_bias", True),
    )  # fmt: skip
    return activated(OverRows(module), spec), (out[1], filters)


def _sequence(spec: LayerSpec, shape: Shape) -> Pair:
    if len(shape) != 2:
        raise ValueError(f"{spec.label}: needs steps x channels, not a shape of {by(shape)}")
    return shape[0], shape[1]


def pool(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    """Build a pooling of images."""
    rows, columns, channels = image_of(spec, shape, first)
    size = spec.pair("pool_size", [2, 2])
    stride = spec.pair("strides", list(size))
    pads, out = _window(spec, (rows, columns), size, stride)
    module = _pooling(spec.values["layer"].startswith("Max"), size, stride, pads, (rows, columns))
    return module, shape_of(*out, channels, first)


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


def pool1d(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    """Build a pooling of sequences."""
    steps, channels = _sequence(spec, shape)
    size = spec.whole("pool_size", 2)
    stride = spec.whole("strides", size)
    pads, out = _window(spec, (1, steps), (1, size), (1, stride))
    maximum = spec.values["layer"].startswith("Max")
    module = _pooling(maximum, (1, size), (1, stride), pads, (1, steps))
    return OverRows(module), (out[1], channels)


def global_pool(spec: LayerSpec, shape: Shape, first: bool) -> Built:
    """Build a pooling over the whole image."""
    *_, channels = image_of(spec, shape, first)
    keep = spec.flag("keepdims", False)
    module = GlobalPool("Max" in spec.values["layer"], keep)
    return module, shape_of(1, 1, channels, first) if keep else (channels,)

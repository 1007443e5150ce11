"""Read specs of layers, and build convolutions and poolings from them; see `spec_builders`.

A spec has plain values from an untrusted file; each is checked when it is read.
"""

from collections.abc import Callable, Mapping, Sequence

from torch import nn

from zoo.base.limits import is_ordinary
from zoo.models.image_layers import (
    GlobalPool,
    OverRows,
    PaddedAvgPool2d,
    PaddedConv2d,
    PaddedMaxPool2d,
    Pads,
)
from zoo.models.value_layers import ACTIVATIONS

MOST_TEXT = 40  # characters of a value in a message
Shape = tuple[int, ...]
Pair = tuple[int, int]
Built = tuple[nn.Module, Shape]
Builder = Callable[["LayerSpec", Shape, bool], Built]
# TensorFlow's `same` and Theano's, which pads half a window in front, also with a stride.
PADDINGS = ("valid", "same", "same_theano")


class LayerSpec:
    """A layer's plain values; every value is checked when it is read.

    Args:
        values: `layer`, the layer's class, and its settings, named as in Keras 2.
        label: text on the layer for messages, such as `layer 3 (Conv2D)`.
    """

    def __init__(self, values: Mapping, label: str) -> None:
        self.values, self.label = values, label
        self._read = {"layer", "data_format"}

    def whole(
        self, key: str, default: int | None = None, least: int = 1, most: int = 65_536
    ) -> int:
        """Return a whole number."""
        return self._whole(key, self._value(key, default), least, most)

    def number(self, key: str, default: float | None = None, most: float = 1e6) -> float:
        """Return a finite number in -most..most."""
        return self._number(key, self._value(key, default), most)

    def share(self, key: str) -> float:
        """Return a rate of 0 or more, below 1."""
        rate = self.number(key)
        if not 0 <= rate < 1:
            raise self.wrong(key, "is not a rate of 0 or more, below 1")
        return rate

    def flag(self, key: str, default: bool) -> bool:
        """Return true or false."""
        value = self._value(key, default)
        if not isinstance(value, bool):
            raise self.wrong(key, "is not true or false")
        return value

    def word(self, key: str, known: Sequence[str], default: str | None = None) -> str:
        """Return one of the known words."""
        value = self._value(key, default)
        if not isinstance(value, str) or value not in known:
            raise self.wrong(key, f"is not one of {', '.join(known)}")
        return value

    def wholes(
        self, key: str, default: list[int] | None = None, least: int = 1, most: int = 65_536
    ) -> list[int]:
        """Return a list of up to 8 whole numbers."""
        value = self._value(key, default)
        if not isinstance(value, list | tuple) or len(value) > 8:
            raise self.wrong(key, "is not a list of whole numbers")
        return [self._whole(key, one, least, most) for one in value]

    def pair(
        self, key: str, default: list[int] | None = None, least: int = 1, most: int = 4096
    ) -> tuple[int, int]:
        """Return two whole numbers, of rows and columns."""
        found = self.wholes(key, default, least, most)
        if len(found) != 2:
            raise self.wrong(key, "is not two whole numbers")
        return found[0], found[1]

    def edges(self, key: str) -> tuple[int, int, int, int]:
        """Return whole numbers of `[[top, bottom], [left, right]]`."""
        value = self._value(key, None)
        if not isinstance(value, list | tuple) or [
            len(one) if isinstance(one, list | tuple) else 0 for one in value
        ] != [2, 2]:
            raise self.wrong(key, "is not [[top, bottom], [left, right]]")
        (top, bottom), (left, right) = value
        numbers = [self._whole(key, one, 0, 4096) for one in (top, bottom, left, right)]
        return numbers[0], numbers[1], numbers[2], numbers[3]

    def numbers(self, key: str, default: float | None = None, most: float = 1e6) -> list[float]:
        """Return a list of numbers; a single number is a list of one."""
        value = self._value(key, default)
        many = value if isinstance(value, list | tuple) else [value]
        if not 0 < len(many) <= 4096:
            raise self.wrong(key, "is not a number or a list of them")
        return [self._number(key, one, most) for one in many]

    def check_all_read(self) -> None:
        """Raise ValueError for a key that the layer does not have."""
        for key in self.values:
            if key not in self._read:
                raise ValueError(f"{self.label}: has no setting {key!r:.{MOST_TEXT}}; remove it")

    def wrong(self, key: str, reason: str) -> ValueError:
        """Return an error about a key's value."""
        return ValueError(f"{self.label}: {key}={self.values.get(key)!r:.{MOST_TEXT}} {reason}")

    def _value(self, key: str, default: object) -> object:
        self._read.add(key)
        value = self.values.get(key, default)
        if value is None:
            raise ValueError(f"{self.label}: lacks {key}; set it")
        return value

    def _whole(self, key: str, value: object, least: int, most: int) -> int:
        if type(value) is not int or not least <= value <= most:
            raise self.wrong(key, f"is not whole, in {least}..{most}")
        return value

    def _number(self, key: str, value: object, most: float) -> float:
        if not is_ordinary(value, most=most):
            raise self.wrong(key, f"is not a number in {-most:g}..{most:g}")
        return float(value)


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


def by(shape: Sequence[int]) -> str:
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

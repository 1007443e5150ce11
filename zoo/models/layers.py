"""Layers and helpers that several networks of the zoo use."""

import math
from collections.abc import Callable
from typing import Any, Sequence  # noqa: UP035 torch 2.4 accepts no other

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor, library, nn

from zoo.models.network_facts import NetworkFacts

ACTIVATIONS = {"elu": nn.ELU, "relu": nn.ReLU}
# Pixel values of 32 of PilotNet's images: the activations of more exceed a processor's caches
# (docs/performance.md#where-the-time-goes).
PIECE = 1_270_000


def activation_layer(name: str) -> nn.Module:
    """Return the activation layer of a name, `elu` or `relu`; raise ValueError for another."""
    if name not in ACTIVATIONS:
        raise ValueError(f"model.activation={name!r}: set one of {', '.join(ACTIVATIONS)}")
    return ACTIVATIONS[name]()


def piece_length(images: Tensor) -> int:
    """Return how many of these images, or windows of them, a device computes fastest at a time."""
    if images.device.type == "cpu" and len(images):
        # Powers of 2 gave convolutions the values of the whole batch, to the bit; others did not.
        return 1 << (PIECE // images[0].numel() or 1).bit_length() - 1
    return max(1, len(images))


def in_pieces(function: Callable[[Tensor], Tensor], images: Tensor) -> Tensor:
    """Return a function's values of images [N, ...], computed for `piece_length` at a time."""
    return torch.cat([function(piece) for piece in images.split(piece_length(images))])


SCALE = (127.5, 1.0)  # to -1..1


class Normalize(nn.Module):
    """A layer that scales pixels 0..255, so that only uint8 is copied to the device.

    Args:
        scale: divisor of the pixels, and the number subtracted afterwards.

    Raises:
        ValueError: the scale is not two finite numbers, or its divisor is 0.
    """

    of_network: Tensor

    def __init__(self, scale: Sequence[float] = SCALE) -> None:
        super().__init__()
        self.divisor, self.shift = checked_scale(scale)
        # The network's numbers, whatever its conversion: bfloat16, single or double precision.
        self.register_buffer("of_network", torch.empty(0), persistent=False)

    def forward(self, images: Tensor) -> Tensor:
        """Return float images: pixel / divisor - shift."""
        return images.to(self.of_network.dtype) / self.divisor - self.shift

    def extra_repr(self) -> str:
        """Return the scale, for a printed network."""
        return f"pixel / {self.divisor:g} - {self.shift:g}"


def checked_scale(scale: object) -> tuple[float, float]:
    """Return a scale as two floats; raise ValueError if it is none."""
    most = torch.finfo(torch.float32).max
    pair: Any = scale if isinstance(scale, list | tuple) and len(scale) == 2 else ("", "")
    if all(type(number) in (int, float) and abs(number) < most for number in pair):
        divisor, shift = map(float, pair)
        if divisor and 255 / abs(divisor) < most:
            return divisor, shift
    raise ValueError(
        f"model.scale={scale!s:.100}: should be two finite numbers, the first not 0; set "
        '"model.scale=[127.5,1]" for pixel / 127.5 - 1'
    )


class OneFrame(nn.Module):
    """A network that steers by one frame: a subclass sets `features` and `head`."""

    facts = NetworkFacts()
    features: nn.Module
    head: nn.Module

    def forward(self, images: Tensor) -> Tensor:
        """Return the steering [N, 1] for images [N, C, H, W]."""
        return self.head(self.features(images).flatten(1))


class SameConv2d(nn.Conv2d):
    """A convolution with TensorFlow's "same" padding: an odd padding adds more at the end."""

    def forward(self, images: Tensor) -> Tensor:
        """Return the convolution of padded images."""
        padding: list[int] = []
        sizes = zip(images.shape[2:], self.kernel_size, self.stride, strict=True)
        for size, kernel, stride in sizes:
            # Not -(-size // stride): a traced division rounds towards 0.
            total = max(((size - 1) // stride) * stride + kernel - size, 0)
            padding = [total // 2, total - total // 2, *padding]  # F.pad takes the width first
        return super().forward(F.pad(images, padding))


class LogSpread(nn.Module):
    """A last layer that keeps the last column between -5 and 1, as the logarithm of a spread.

    The steering's standard deviation is so between 0.0067 and 2.7. The bound is smooth: a hard one
    would stop the gradient of every sample that is out of range. Training starts near 0.14.
    """

    def forward(self, outputs: Tensor) -> Tensor:
        """Return the outputs, [N, columns], with the last column bounded."""
        return torch.cat([outputs[:, :-1], 3 * torch.tanh(outputs[:, -1:]) - 2], dim=1)


class Dropout(nn.Dropout):
    """torch's dropout with far cheaper random numbers on a CPU.

    On a CPU torch draws one number after the other, and on one core only unless the processor is
    Intel's. This takes a fifth of PilotNet's training step on one core, and more on several.

    Here two tables of random bits are drawn once per process. Each call draws an offset into each
    table, and a value's 16 random bits are the exclusive-or of the tables' bits from there on. The
    values of one call are independent. So are those of two calls, unless their offsets differ by
    the same amount in both tables: one pair of calls in a million. The rate is exact to 1/65536.
    """

    def forward(self, values: Tensor) -> Tensor:
        """Return the values with a share of them set to 0, in training mode."""
        small = values.numel() < 4_000  # torch is as fast here
        if not self.training or not 0 < self.p < 1 or values.device.type != "cpu" or small:
            return super().forward(values)
        last = values.ndim == 4 and values.is_contiguous(memory_format=torch.channels_last)
        offsets = torch.randint(_OFFSETS, (2,))
        if torch.compiler.is_compiling():
            return values * kept_values(offsets, values.shape, self.p, last).to(values.dtype)
        return values * _kept(offsets, values.shape, self.p, last, values.dtype)


@library.custom_op("drivezoo::kept_values", mutates_args=())
def kept_values(offsets: Tensor, shape: Sequence[int], rate: float, channels_last: bool) -> Tensor:
    """Return the factors of a dropout, float32, as one operator of a compiled step.

    The operator does not take the values, so the compiler can fuse the operators before and after
    it. It takes freshly drawn offsets, so the compiler does not merge two calls of the same shape.
    """
    return _kept(offsets, shape, rate, channels_last, torch.float32)


@kept_values.register_fake
def _(offsets: Tensor, shape: Sequence[int], rate: float, channels_last: bool) -> Tensor:
    layout = torch.channels_last if channels_last else torch.contiguous_format
    return torch.empty(shape, memory_format=layout)


def _kept(
    offsets: Tensor, shape: Sequence[int], rate: float, channels_last: bool, dtype: torch.dtype
) -> Tensor:
    """Return factors: 0 with probability `rate`, else the number that keeps the mean."""
    count, dropped = math.prod(shape), round(rate * 2**16)
    words = -(-count // 4)
    first, second = (
        table[offset : offset + words]
        for table, offset in zip(_tables(words), offsets.tolist(), strict=True)
    )
    bits = torch.bitwise_xor(first, second).view(torch.int16)[:count]
    kept = torch.empty(count, dtype=dtype)
    torch.ge(bits, dropped - 2**15, out=kept).mul_(1 / (1 - dropped / 2**16))
    if channels_last:
        samples, channels, height, width = shape
        return kept.view(samples, height, width, channels).permute(0, 3, 1, 2)
    return kept.view(shape)


_OFFSETS = 2**20
_drawn: list[Tensor] = []


def _tables(words: int) -> list[Tensor]:
    """Return two tables of random int64, with `words` or more after each offset.

    A longer table starts with the same numbers.
    """
    if not _drawn or len(_drawn[0]) < _OFFSETS + words:
        _drawn[:] = (
            torch.from_numpy(np.random.SFC64(seed).random_raw(_OFFSETS + words)).view(torch.int64)
            for seed in (1, 2)
        )
    return _drawn


def feature_shape(features: nn.Module, shape: tuple[int, int, int], name: str) -> torch.Size:
    """Return the shape [C, H, W] of the features of a view.

    Args:
        features: convolutional layers.
        shape: `(channels, height, width)` of the view.
        name: network's class, for the message.

    Raises:
        ValueError: the view is too small for the layers.
    """
    training = features.training
    features.eval()
    try:
        with torch.no_grad():
            out = features(torch.zeros(1, *shape))
    except RuntimeError:
        out = None
    features.train(training)
    if out is None or out.numel() == 0:
        raise ValueError(
            f"{name}: a view of {shape[1]} x {shape[2]} pixels is too small for its layers; set a "
            "larger model.size, or crop less (data.crop)"
        )
    return out.shape[1:]


class Crop(nn.Module):
    """A layer that removes rows and columns from the edges.

    Args:
        edges: number of rows or columns at the top, bottom, left and right.
        size: rows and columns of the output.
    """

    def __init__(self, edges: tuple[int, int, int, int], size: tuple[int, int]) -> None:
        super().__init__()
        self.top, self.bottom, self.left, self.right = edges
        self.rows, self.columns = size

    def forward(self, images: Tensor) -> Tensor:
        """Return the images without their edges."""
        images = images[:, :, self.top : self.top + self.rows]
        return images[:, :, :, self.left : self.left + self.columns]

    def extra_repr(self) -> str:
        """Return the settings that a printed network shows."""
        return f"{self.top}, {self.bottom}, {self.left}, {self.right}"


class InKerasOrder(nn.Module):
    """A layer for tensors in Keras' order of axes, [N, H, W, C] for images.

    Args:
        layer: layer that takes and returns this order.
    """

    def __init__(self, layer: nn.Module) -> None:
        super().__init__()
        self.layer = layer

    def forward(self, values: Tensor) -> Tensor:
        """Return the layer's output."""
        if values.ndim == 4:
            values = values.permute(0, 2, 3, 1)
        values = self.layer(values)
        return values.permute(0, 3, 1, 2) if values.ndim == 4 else values


class Unbin(nn.Module):
    """A layer that returns a number for each group of bins: that of the bin of the largest value.

    In training, its gradient is that of the mean of all bins' numbers, weighed by their softmax
    (straight-through estimator: Bengio et al., 2013, arXiv:1308.3432).

    Args:
        bins: number of bins of each group.
        lows: number of each group's first bin.
        steps: difference between two bins of each group.
    """

    def __init__(self, bins: list[int], lows: list[float], steps: list[float]) -> None:
        super().__init__()
        self.groups = list(zip(bins, lows, steps, strict=True))

    def forward(self, values: Tensor) -> Tensor:
        """Return the numbers, [N, groups], for values [N, bins of all groups]."""
        numbers = []
        for group, (bins, low, step) in zip(
            values.split([bins for bins, *_ in self.groups], dim=1), self.groups, strict=True
        ):
            number = group.argmax(1).to(values.dtype)
            if self.training:
                places = torch.arange(bins, dtype=values.dtype, device=values.device)
                mean = group.softmax(1) @ places
                number = number + mean - mean.detach()
            numbers.append(low + step * number)
        return torch.stack(numbers, dim=1)

"""What several networks of the zoo share."""

import math
from typing import Sequence  # noqa: UP035 torch 2.4 knows an operator's lists by no other

import numpy as np
import torch
from torch import Tensor, library, nn

ACTIVATIONS = {"elu": nn.ELU, "relu": nn.ReLU}


def activation_layer(name: str) -> nn.Module:
    """`nn.ELU` or `nn.ReLU` by its name; ValueError for another."""
    if name not in ACTIVATIONS:
        raise ValueError(f"activation={name!r} is not one of {', '.join(ACTIVATIONS)}")
    return ACTIVATIONS[name]()


class Normalize(nn.Module):
    """Scale pixels 0..255 to -1..1, on the device, so that uint8 is what crosses to it."""

    def forward(self, images: Tensor) -> Tensor:
        dtype = images.dtype if images.is_floating_point() else torch.get_default_dtype()
        return images.to(dtype) / 127.5 - 1.0


class Dropout(nn.Dropout):
    """torch's dropout, whose draws cost next to nothing on a CPU.

    torch draws one number after the other there, on one core where the processor is not Intel's: a
    fifth of PilotNet's step on one core, more on several. Here two tables are drawn once, and a
    value's 16 bits are those of the one exclusive-or those of the other, each read from a place
    that torch draws. So within a call all are independent, and so are those of two calls unless
    both places lie equally far apart: one pair in a million. The rate is kept to 1/65536.
    """

    def forward(self, values: Tensor) -> Tensor:
        small = values.numel() < 4_000  # where torch's draws cost no more than these calls
        if not self.training or not 0 < self.p < 1 or values.device.type != "cpu" or small:
            return super().forward(values)
        last = values.ndim == 4 and values.is_contiguous(memory_format=torch.channels_last)
        places = torch.randint(_PLACES, (2,))
        if torch.compiler.is_compiling():
            return values * kept_values(places, values.shape, self.p, last).to(values.dtype)
        return values * _kept(places, values.shape, self.p, last, values.dtype)


@library.custom_op("drivezoo::kept_values", mutates_args=())
def kept_values(places: Tensor, shape: Sequence[int], rate: float, channels_last: bool) -> Tensor:
    """What a dropout multiplies with, float32, for a compiled step, which need not look within.

    It takes no values, so that the compiler can make one loop of what comes before and after; and
    places that are drawn anew, so that it does not take two of the same shape for one.
    """
    return _kept(places, shape, rate, channels_last, torch.float32)


@kept_values.register_fake
def _(places: Tensor, shape: Sequence[int], rate: float, channels_last: bool) -> Tensor:
    layout = torch.channels_last if channels_last else torch.contiguous_format
    return torch.empty(shape, memory_format=layout)


def _kept(
    places: Tensor, shape: Sequence[int], rate: float, channels_last: bool, dtype: torch.dtype
) -> Tensor:
    """0 with the chance `rate`, otherwise what keeps the mean."""
    count, dropped = math.prod(shape), round(rate * 2**16)
    words = -(-count // 4)
    one, other = (
        table[place : place + words]
        for table, place in zip(_tables(words), places.tolist(), strict=True)
    )
    bits = torch.bitwise_xor(one, other).view(torch.int16)[:count]
    kept = torch.empty(count, dtype=dtype)
    torch.ge(bits, dropped - 2**15, out=kept).mul_(1 / (1 - dropped / 2**16))
    if channels_last:
        samples, channels, height, width = shape
        return kept.view(samples, height, width, channels).permute(0, 3, 1, 2)
    return kept.view(shape)


_PLACES = 2**20
_drawn: list[Tensor] = []


def _tables(words: int) -> list[Tensor]:
    """Two of random words, int64, at least `words` from each place; a longer one begins alike."""
    if not _drawn or len(_drawn[0]) < _PLACES + words:
        _drawn[:] = (
            torch.from_numpy(np.random.SFC64(seed).random_raw(_PLACES + words)).view(torch.int64)
            for seed in (1, 2)
        )
    return _drawn


def feature_shape(features: nn.Module, shape: tuple[int, int, int], name: str) -> torch.Size:
    """The `[C, H, W]` that convolutional `features` make of a view of `shape`.

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
            f"{name}: a view of {shape[1]} x {shape[2]} pixels is too small for its layers; "
            "crop less or set a larger model.size"
        )
    return out.shape[1:]

"""What several networks of the zoo share."""

import numpy as np
import torch
from torch import Tensor, nn

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
    """torch's dropout, whose draws cost a tenth on a CPU.

    torch draws one number after the other there, on one core where the processor is not Intel's: a
    fifth of PilotNet's step on one core, more on several. Here numpy draws 64 bits for four values,
    from a seed that torch draws. The rate is kept to 1/65536.
    """

    def forward(self, values: Tensor) -> Tensor:
        small = values.numel() < 20_000  # where a call costs more than the draws
        if not self.training or not 0 < self.p < 1 or values.device.type != "cpu" or small:
            return super().forward(values)
        if torch.compiler.is_compiling():
            return super().forward(values)  # a compiled one draws within its loops
        rng = np.random.Generator(np.random.SFC64(int(torch.randint(2**62, ()))))
        words = rng.integers(
            2**64 - 1, size=-(-values.numel() // 4), dtype=np.uint64, endpoint=True
        )
        bits = torch.from_numpy(words).view(torch.int16)[: values.numel()]
        dropped = round(self.p * 2**16)
        kept = torch.empty(values.numel(), dtype=values.dtype)
        torch.ge(bits, dropped - 2**15, out=kept).mul_(1 / (1 - dropped / 2**16))
        if values.ndim == 4 and values.is_contiguous(memory_format=torch.channels_last):
            count, channels, height, width = values.shape
            return values * kept.view(count, height, width, channels).permute(0, 3, 1, 2)
        return values * kept.view(values.shape)


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

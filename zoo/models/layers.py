"""What several networks of the zoo share."""

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

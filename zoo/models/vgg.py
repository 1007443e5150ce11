"""VGG16 transfer: Simonyan and Zisserman, "Very Deep Convolutional Networks", 2014.

arXiv:1409.1556. The convolutions have the names of the public PyTorch weights
(`features.0.weight` ...), so a downloaded state dict loads without changes.
"""

import torch
from torch import Tensor, nn

from zoo.models.transfer import Transfer, check_trainable_blocks

BLOCKS = [[64, 64], [128, 128], [256, 256, 256], [512, 512, 512], [512, 512, 512]]


class ImageNetNormalize(nn.Module):
    """A layer that gives pixels 0..255 ImageNet's zero mean and unit deviation, as for VGG16."""

    mean: Tensor
    std: Tensor

    def __init__(self) -> None:
        super().__init__()
        mean = torch.tensor([0.485, 0.456, 0.406]).view(3, 1, 1)
        std = torch.tensor([0.229, 0.224, 0.225]).view(3, 1, 1)
        self.register_buffer("mean", mean * 255, persistent=False)
        self.register_buffer("std", std * 255, persistent=False)

    def forward(self, images: Tensor) -> Tensor:
        """Return normalized float images [N, 3, H, W]."""
        return (images.to(self.mean.dtype) - self.mean) / self.std


class Vgg16(Transfer):
    """VGG16's convolutions with a regression head.

    Args:
        shape: `(3, height, width)` of the view, RGB, 32 x 32 pixels or more.
        trainable_blocks: number of trained blocks, 0 to 5, counted from the last.
        activation: `elu` or `relu`, in the head.
        dropout: rate before the output.
        units: number of units in the head's hidden layer.
    """

    published_name = "VGG16"
    imagenet_source = "https://download.pytorch.org/models/vgg16-397923af.pth"

    def __init__(
        self,
        shape: tuple[int, int, int],
        trainable_blocks: int = 1,
        activation: str = "elu",
        dropout: float = 0.5,
        units: int = 128,
    ) -> None:
        check_trainable_blocks(trainable_blocks, len(BLOCKS))
        layers: list[nn.Module] = []
        begins, channels = [], 3  # the first layer of each block
        for block in BLOCKS:
            begins.append(len(layers))
            for out in block:
                layers += [nn.Conv2d(channels, out, 3, padding=1), nn.ReLU()]
                channels = out
            layers += [nn.MaxPool2d(2)]
        for layer in layers:
            if isinstance(layer, nn.Conv2d) and layer.bias is not None:
                # With PyTorch's default weights the signal vanishes over thirteen layers.
                nn.init.kaiming_normal_(layer.weight, mode="fan_out", nonlinearity="relu")
                nn.init.zeros_(layer.bias)
        frozen = [*begins, len(layers)][len(BLOCKS) - trainable_blocks]
        features = nn.Sequential(*layers)
        super().__init__(shape, ImageNetNormalize(), features, frozen, activation, dropout, units)

    @staticmethod
    def public_state(state: dict[str, Tensor]) -> dict[str, Tensor]:
        """Return the convolutions' tensors; the classifier's are left out."""
        return {key: tensor for key, tensor in state.items() if not key.startswith("classifier.")}

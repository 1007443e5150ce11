"""VGG16 transfer: Simonyan and Zisserman, "Very Deep Convolutional Networks", 2014.

arXiv:1409.1556. The convolutions have the names of the public PyTorch weights
(`features.0.weight` ...), so a downloaded state dict loads without changes.
"""

from itertools import islice

import torch
from torch import Tensor, nn

from zoo.models.layers import activation_layer, feature_shape

BLOCKS = [[64, 64], [128, 128], [256, 256, 256], [512, 512, 512], [512, 512, 512]]


class ImageNetNormalize(nn.Module):
    """A layer that gives pixels 0..255 ImageNet's zero mean and unit deviation, as for VGG16."""

    def __init__(self) -> None:
        super().__init__()
        mean = torch.tensor([0.485, 0.456, 0.406]).view(3, 1, 1)
        std = torch.tensor([0.229, 0.224, 0.225]).view(3, 1, 1)
        self.register_buffer("mean", mean * 255, persistent=False)
        self.register_buffer("std", std * 255, persistent=False)

    def forward(self, images: Tensor) -> Tensor:
        """Return normalized float images [N, 3, H, W]."""
        return (images.to(self.mean.dtype) - self.mean) / self.std


class Vgg16(nn.Module):
    """VGG16's convolutions with a regression head.

    Args:
        shape: `(3, height, width)` of the view, RGB, 32 x 32 pixels or more.
        trainable_blocks: number of trained blocks, 0 to 5, counted from the last.
        activation: `elu` or `relu`, in the head.
        dropout: rate before the output.
        units: number of units in the head's hidden layer.
    """

    takes_speed = False
    outputs = 1

    def __init__(
        self,
        shape: tuple[int, int, int],
        trainable_blocks: int = 1,
        activation: str = "elu",
        dropout: float = 0.5,
        units: int = 128,
    ) -> None:
        super().__init__()
        if shape[0] != 3:
            raise ValueError(f"Vgg16 takes 3 channels, not {shape[0]}: set model.colour=rgb")
        if trainable_blocks not in range(len(BLOCKS) + 1):
            raise ValueError(
                f"model.trainable_blocks={trainable_blocks}: set a number from 0 to {len(BLOCKS)}"
            )
        layers: list[nn.Module] = []
        first_trainable = 0
        channels = 3
        for number, block in enumerate(BLOCKS):
            if number == len(BLOCKS) - trainable_blocks:
                first_trainable = len(layers)
            for out in block:
                layers += [nn.Conv2d(channels, out, 3, padding=1), nn.ReLU()]
                channels = out
            layers += [nn.MaxPool2d(2)]
        if trainable_blocks == 0:
            first_trainable = len(layers)
        self._frozen_layers = first_trainable
        self.normalize = ImageNetNormalize()
        self.features = nn.Sequential(*layers)
        for layer in self.features:
            if isinstance(layer, nn.Conv2d):
                # With PyTorch's default weights the signal vanishes over thirteen layers.
                nn.init.kaiming_normal_(layer.weight, mode="fan_out", nonlinearity="relu")
                nn.init.zeros_(layer.bias)
        for layer in self.features[:first_trainable]:
            layer.requires_grad_(False)
        self.head = nn.Sequential(
            nn.Linear(feature_shape(self.features, shape, "Vgg16").numel(), units),
            activation_layer(activation),
            nn.Dropout(dropout),
            nn.Linear(units, 1),
        )

    @property
    def backbone(self) -> nn.Module:
        """The pretrained part, which can have its own learning rate (`optim.backbone_lr`)."""
        return self.features

    @property
    def frozen_front(self) -> nn.Module | None:
        """The frozen layers, whose features of an image never change; None without any."""
        if not self._frozen_layers:
            return None
        return nn.Sequential(self.normalize, *self.features[: self._frozen_layers])

    def front(self, images: Tensor) -> Tensor:
        """Return the features [N, c, h, w] of the frozen layers."""
        features = self.normalize(images)
        for layer in islice(self.features, self._frozen_layers):
            features = layer(features)
        return features

    def rest(self, features: Tensor) -> Tensor:
        """Return the steering [N, 1] for the frozen layers' features, of any float dtype."""
        features = features.to(self.head[-1].weight.dtype)
        for layer in islice(self.features, self._frozen_layers, None):
            features = layer(features)
        return self.head(features.flatten(1))

    def forward(self, images: Tensor) -> Tensor:
        """Return the steering [N, 1] for images [N, 3, H, W]."""
        return self.rest(self.front(images))

"""VGG16 transfer: Simonyan and Zisserman, "Very Deep Convolutional Networks", 2014.

arXiv:1409.1556. The convolutional blocks carry the names of the public PyTorch weights
(`features.0.weight` ...), so that a downloaded state dict loads as it is.
"""

from itertools import islice

import torch
from torch import Tensor, nn

from zoo.models.layers import activation_layer, feature_shape

BLOCKS = [[64, 64], [128, 128], [256, 256, 256], [512, 512, 512], [512, 512, 512]]


class ImageNetNormalize(nn.Module):
    """Pixels 0..255 to zero mean and unit deviation over ImageNet, as VGG16 was trained."""

    def __init__(self) -> None:
        super().__init__()
        mean = torch.tensor([0.485, 0.456, 0.406]).view(3, 1, 1)
        std = torch.tensor([0.229, 0.224, 0.225]).view(3, 1, 1)
        self.register_buffer("mean", mean * 255, persistent=False)
        self.register_buffer("std", std * 255, persistent=False)

    def forward(self, images: Tensor) -> Tensor:
        return (images.to(self.mean.dtype) - self.mean) / self.std


class Vgg16(nn.Module):
    """VGG16's convolutions under a regression head.

    Args:
        shape: `(3, height, width)` of the view, RGB, 32 x 32 pixels or more.
        trainable_blocks: how many of the five blocks learn, counted from the last.
        activation: `elu` or `relu`, of the head.
        dropout: the rate before the output.
        units: the width of the head's hidden layer.
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
            raise ValueError("Vgg16 wants colour: set model.colour=rgb")
        if trainable_blocks not in range(len(BLOCKS) + 1):
            raise ValueError(f"trainable_blocks={trainable_blocks} is not 0 to {len(BLOCKS)}")
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
                # PyTorch's usual weights let the signal die out over thirteen layers.
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
        """The part with weights of its own, which may learn at another rate (`optim`)."""
        return self.features

    @property
    def frozen_front(self) -> nn.Module | None:
        """The layers of `front`, where it has weights, all frozen: what it makes of a picture stays
        the same."""
        if not self._frozen_layers:
            return None
        return nn.Sequential(self.normalize, *self.features[: self._frozen_layers])

    def front(self, images: Tensor) -> Tensor:
        """Features [N, c, h, w] by the blocks that are frozen, counted from the first."""
        features = self.normalize(images)
        for layer in islice(self.features, self._frozen_layers):
            features = layer(features)
        return features

    def rest(self, features: Tensor) -> Tensor:
        """Steering [N, 1] by the other blocks and the head; `features` of any float type."""
        features = features.to(self.head[-1].weight.dtype)
        for layer in islice(self.features, self._frozen_layers, None):
            features = layer(features)
        return self.head(features.flatten(1))

    def forward(self, images: Tensor) -> Tensor:
        return self.rest(self.front(images))

"""PilotNet: Bojarski et al., "End to End Learning for Self-Driving Cars", 2016, arXiv:1604.07316.

ELU, and a dropout that rises from layer to layer, as in a well-known solution of the course.
"""

from collections.abc import Sequence

import torch
from torch import Tensor, nn

from zoo.models.layers import SCALE, Dropout, LogSpread, Normalize, activation_layer, feature_shape
from zoo.models.network_facts import NetworkFacts

CONVOLUTIONS = [(24, 5, 2), (36, 5, 2), (48, 5, 2), (64, 3, 1), (64, 3, 1)]
DENSE = [100, 50, 10]


def convolutions(
    channels: int,
    activation: str,
    rates: Sequence[float],
    width: float = 1.0,
    scale: tuple[float, float] = SCALE,
) -> nn.Sequential:
    """Return PilotNet's convolutions: 66 x 200 -> 31 x 98, 14 x 47, 5 x 22, 3 x 20, 1 x 18.

    `rates` are those of the dropout after each one; for the other arguments see `PilotNet`.
    """
    layers: list[nn.Module] = [Normalize(scale)]
    for (out, kernel, stride), rate in zip(CONVOLUTIONS, rates, strict=False):
        out = max(1, round(out * width))
        layers += [nn.Conv2d(channels, out, kernel, stride), activation_layer(activation)]
        layers += [Dropout(rate)]
        channels = out
    return nn.Sequential(*layers)


class PilotNet(nn.Module):
    """NVIDIA's PilotNet: 252,219 parameters at 3 x 66 x 200.

    Args:
        shape: `(channels, height, width)` of the view.
        activation: `elu` or `relu`.
        dropout: rates after the first and the last hidden layer; rates between rise evenly.
        width: factor on the channels and units of every hidden layer.
        speed: whether it takes the speed, too, and returns steering and throttle.
        spread: whether it returns one more column, the logarithm of the steering's standard
            deviation (Nix and Weigend 1994); train it with `loss=gaussian`.
        scale: divisor of the pixels, and the number subtracted afterwards.
    """

    def __init__(
        self,
        shape: tuple[int, int, int],
        activation: str = "elu",
        dropout: tuple[float, float] = (0.1, 0.5),
        width: float = 1.0,
        speed: bool = False,
        spread: bool = False,
        scale: tuple[float, float] = SCALE,
    ) -> None:
        super().__init__()
        rates = torch.linspace(*dropout, len(CONVOLUTIONS) + len(DENSE)).tolist()
        self.facts = NetworkFacts(2 if speed else 1, takes_speed=speed, predicts_spread=spread)
        self.features = convolutions(shape[0], activation, rates, width, scale)

        units = feature_shape(self.features, shape, "PilotNet").numel() + speed
        layers: list[nn.Module] = []
        for out, rate in zip(DENSE, rates[len(CONVOLUTIONS) :], strict=True):
            out = max(1, round(out * width))
            layers += [nn.Linear(units, out), activation_layer(activation), Dropout(rate)]
            units = out
        layers.append(nn.Linear(units, self.facts.columns))
        self.head = nn.Sequential(*layers, *([LogSpread()] if spread else []))

    def forward(self, images: Tensor, speed: Tensor | None = None) -> Tensor:
        """Return the steering, the throttle with a speed, and the spread's logarithm if any."""
        features = self.features(images).flatten(1)
        if self.facts.takes_speed and speed is not None:
            # 30 mph is the simulator's top speed, so the input is in 0..1, in the features' range.
            features = torch.cat([features, speed.to(features.dtype)[:, None] / 30.0], dim=1)
        return self.head(features)

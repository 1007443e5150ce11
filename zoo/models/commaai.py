"""comma.ai's steering network, 2016: https://github.com/commaai/research."""

from torch import nn

from zoo.models.layers import (
    SCALE,
    Dropout,
    Normalize,
    OneFrame,
    SameConv2d,
    activation_layer,
    feature_shape,
)


class CommaAi(OneFrame):
    """comma.ai's network: 6,621,809 parameters at 3 x 160 x 320.

    The first dense layer holds nearly all of them.

    Args:
        shape: `(channels, height, width)` of the view.
        activation: `elu` or `relu`.
        dropout: rates before and after the first dense layer.
        width: factor on the channels and units of every hidden layer.
        scale: divisor of the pixels, and the number subtracted afterwards.
    """

    def __init__(
        self,
        shape: tuple[int, int, int],
        activation: str = "elu",
        dropout: tuple[float, float] = (0.2, 0.5),
        width: float = 1.0,
        scale: tuple[float, float] = SCALE,
    ) -> None:
        super().__init__()
        c1, c2, c3, f1 = (max(1, round(n * width)) for n in (16, 32, 64, 512))
        self.features = nn.Sequential(
            Normalize(scale),
            SameConv2d(shape[0], c1, 8, 4),
            activation_layer(activation),
            SameConv2d(c1, c2, 5, 2),
            activation_layer(activation),
            SameConv2d(c2, c3, 5, 2),
        )
        self.head = nn.Sequential(
            Dropout(dropout[0]),
            activation_layer(activation),
            nn.Linear(feature_shape(self.features, shape, "CommaAi").numel(), f1),
            Dropout(dropout[1]),
            activation_layer(activation),
            nn.Linear(f1, 1),
        )

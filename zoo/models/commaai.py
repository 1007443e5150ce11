"""comma.ai's steering network, 2016: https://github.com/commaai/research."""

from torch import nn

from zoo.models import layers


class CommaAi(layers.OneFrame):
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
        scale: tuple[float, float] = layers.SCALE,
    ) -> None:
        super().__init__()
        c1, c2, c3, f1 = (max(1, round(n * width)) for n in (16, 32, 64, 512))
        self.features = nn.Sequential(
            layers.Normalize(scale),
            layers.SameConv2d(shape[0], c1, 8, 4),
            layers.activation_layer(activation),
            layers.SameConv2d(c1, c2, 5, 2),
            layers.activation_layer(activation),
            layers.SameConv2d(c2, c3, 5, 2),
        )
        self.head = nn.Sequential(
            layers.Dropout(dropout[0]),
            layers.activation_layer(activation),
            nn.Linear(layers.feature_shape(self.features, shape, "CommaAi").numel(), f1),
            layers.Dropout(dropout[1]),
            layers.activation_layer(activation),
            nn.Linear(f1, 1),
        )

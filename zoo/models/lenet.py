"""LeNet-5: LeCun et al., "Gradient-Based Learning Applied to Document Recognition", 1998.

Max pooling and ReLU, as in the course, and one output instead of ten.
"""

from torch import nn

from zoo.models.layers import SCALE, Normalize, OneFrame, activation_layer, feature_shape


class LeNet(OneFrame):
    """LeNet-5 with one output: 137,741 parameters at 1 x 32 x 64.

    Args:
        shape: `(channels, height, width)` of the view.
        activation: `relu` or `elu`.
        dropout: rate before each of the last two layers.
        width: factor on the channels and units of every hidden layer.
        scale: divisor of the pixels, and the number subtracted afterwards.
    """

    def __init__(
        self,
        shape: tuple[int, int, int],
        activation: str = "relu",
        dropout: float = 0.0,
        width: float = 1.0,
        scale: tuple[float, float] = SCALE,
    ) -> None:
        super().__init__()
        c1, c2, f1, f2 = (max(1, round(n * width)) for n in (6, 16, 120, 84))
        self.features = nn.Sequential(
            Normalize(scale),
            nn.Conv2d(shape[0], c1, 5),
            activation_layer(activation),
            nn.MaxPool2d(2),
            nn.Conv2d(c1, c2, 5),
            activation_layer(activation),
            nn.MaxPool2d(2),
        )
        self.head = nn.Sequential(
            nn.Linear(feature_shape(self.features, shape, "LeNet").numel(), f1),
            activation_layer(activation),
            nn.Dropout(dropout),
            nn.Linear(f1, f2),
            activation_layer(activation),
            nn.Dropout(dropout),
            nn.Linear(f2, 1),
        )

"""Networks of a few dozen parameters that drive, from write-ups of the course's project.

Both look at the saturation channel alone, where the road's edge stands out.
"""

from torch import Tensor, nn

from zoo.models.layers import Normalize, activation_layer, feature_shape


class Tiny(nn.Module):
    """41 parameters at 1 x 11 x 32: the rows are the channels of a one-dimensional picture.

    Args:
        shape: `(1, rows, columns)` of the view.
        activation: `relu` or `elu`.
        dropout: the rate before the output.
        width: scales the two channels.
    """

    takes_speed = False
    outputs = 1

    def __init__(
        self,
        shape: tuple[int, int, int],
        activation: str = "relu",
        dropout: float = 0.3,
        width: float = 1.0,
    ) -> None:
        super().__init__()
        colours, rows, columns = shape
        if colours != 1:
            raise ValueError("Tiny looks at one channel: set model.colour=hsv_s or gray")
        if columns < 4:
            raise ValueError("Tiny pools four columns: set model.size=[rows, 4 or more]")
        channels = max(1, round(2 * width))
        self.features = nn.Sequential(
            Normalize(),
            nn.Flatten(1, 2),  # [N, 1, rows, columns] -> [N, rows, columns]
            nn.Conv1d(rows, channels, 1),
            activation_layer(activation),
            nn.MaxPool1d(4),
            nn.Dropout(dropout),
        )
        self.head = nn.Linear(channels * (columns // 4), 1)

    def forward(self, images: Tensor) -> Tensor:
        return self.head(self.features(images).flatten(1))


class Tiny63(nn.Module):
    """63 parameters at 1 x 16 x 32: one convolution, one pooling, one dense layer.

    Args:
        shape: `(channels, height, width)` of the view.
        activation: `relu` or `elu`.
        dropout: the rate before the output.
        width: scales the two channels.
    """

    takes_speed = False
    outputs = 1

    def __init__(
        self,
        shape: tuple[int, int, int],
        activation: str = "relu",
        dropout: float = 0.0,
        width: float = 1.0,
    ) -> None:
        super().__init__()
        self.features = nn.Sequential(
            Normalize(),
            nn.Conv2d(shape[0], max(1, round(2 * width)), 3),
            activation_layer(activation),
            nn.MaxPool2d(4),
            nn.Dropout(dropout),
        )
        self.head = nn.Linear(feature_shape(self.features, shape, "Tiny63").numel(), 1)

    def forward(self, images: Tensor) -> Tensor:
        return self.head(self.features(images).flatten(1))

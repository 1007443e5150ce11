"""Networks of a few dozen parameters that drive, from reports on the course's project.

Both use only the saturation channel, which shows the road's edge clearly.
"""

from torch import nn

from zoo.models.layers import SCALE, Normalize, OneFrame, activation_layer, feature_shape


class Tiny(OneFrame):
    """A one-dimensional convolution with rows as channels: 41 parameters at 1 x 11 x 32.

    Args:
        shape: `(1, rows, columns)` of the view.
        activation: `relu` or `elu`.
        dropout: rate before the output.
        width: factor on the two channels.
        scale: divisor of the pixels, and the number subtracted afterwards.
    """

    def __init__(
        self,
        shape: tuple[int, int, int],
        activation: str = "relu",
        dropout: float = 0.3,
        width: float = 1.0,
        scale: tuple[float, float] = SCALE,
    ) -> None:
        super().__init__()
        colours, rows, columns = shape
        if colours != 1:
            raise ValueError(
                f"Tiny takes one channel, not {colours}: set model.colour=hsv_s or gray"
            )
        if columns < 4:
            raise ValueError(
                f'Tiny needs 4 columns or more, not {columns}: set "model.size=[rows,columns]"'
            )
        channels = max(1, round(2 * width))
        self.features = nn.Sequential(
            Normalize(scale),
            nn.Flatten(1, 2),  # [N, 1, rows, columns] -> [N, rows, columns]
            nn.Conv1d(rows, channels, 1),
            activation_layer(activation),
            nn.MaxPool1d(4),
            nn.Dropout(dropout),
        )
        self.head = nn.Linear(channels * (columns // 4), 1)


class Tiny63(OneFrame):
    """A convolution, a pooling and a dense layer: 63 parameters at 1 x 16 x 32.

    Args:
        shape: `(channels, height, width)` of the view.
        activation: `relu` or `elu`.
        dropout: rate before the output.
        width: factor on the two channels.
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
        self.features = nn.Sequential(
            Normalize(scale),
            nn.Conv2d(shape[0], max(1, round(2 * width)), 3),
            activation_layer(activation),
            nn.MaxPool2d(4),
            nn.Dropout(dropout),
        )
        self.head = nn.Linear(feature_shape(self.features, shape, "Tiny63").numel(), 1)

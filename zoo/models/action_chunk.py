"""Steering of the next steps at once: action chunks of Zhao et al., 2023, arXiv:2304.13705.

A command reaches the wheels after a delay. The driver measures it, and sends the steering that the
network predicted for that time.
"""

import torch
from torch import Tensor, nn

from zoo.models.layers import SCALE, Dropout, activation_layer, feature_shape
from zoo.models.memory import Stack
from zoo.models.pilotnet import CONVOLUTIONS, convolutions


class ActionChunk(Stack):
    """PilotNet's convolutions, and the steering of now and of `ahead` steps after it.

    Args:
        shape: `(channels, height, width)` of the view.
        sequence: number of frames in a window, stacked as channels.
        stride: number of rows in a step, and between two frames of a window.
        ahead: number of steps after now.
        activation: `elu` or `relu`.
        dropout: rates after the first convolution and before the output.
        width: factor on the channels and units of every hidden layer.
        scale: divisor of the pixels, and the number subtracted afterwards.
    """

    def __init__(
        self,
        shape: tuple[int, int, int],
        sequence: int = 1,
        stride: int = 1,
        ahead: int = 12,
        activation: str = "elu",
        dropout: tuple[float, float] = (0.1, 0.3),
        width: float = 1.0,
        scale: tuple[float, float] = SCALE,
    ) -> None:
        super().__init__(shape, sequence, stride, ahead)
        channels, rows, columns = shape
        stacked = (sequence * channels, rows, columns)
        *rates, last = torch.linspace(*dropout, len(CONVOLUTIONS) + 1).tolist()
        self.features = convolutions(stacked[0], activation, rates, width, scale)
        units = max(1, round(100 * width))
        self.head = nn.Sequential(
            nn.Linear(feature_shape(self.features, stacked, "ActionChunk").numel(), units),
            activation_layer(activation),
            Dropout(last),
            nn.Linear(units, 1 + ahead),
        )

    def outputs_of(self, stacked: Tensor) -> Tensor:
        """Return the steering [N, 1 + ahead, 1] for stacked frames [N, sequence * C, H, W]."""
        return self.head(self.features(stacked).flatten(1))[:, :, None]

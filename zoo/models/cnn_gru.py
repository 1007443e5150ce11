"""Convolutions and a GRU: Cho et al., "... RNN Encoder-Decoder ...", 2014, arXiv:1406.1078.

Eraqi et al., "End-to-End Deep Learning for Steering Autonomous Vehicles Considering Temporal
Dependencies", 2017, arXiv:1710.03804, put such a memory on the convolutions of a steering network.
"""

import torch
from torch import Tensor, nn

from zoo.models.layers import SCALE, Dropout, activation_layer, feature_shape
from zoo.models.memory import Recurrent
from zoo.models.pilotnet import CONVOLUTIONS, convolutions


class GruCell(nn.Module):
    """The gated recurrent unit of `torch.nn.GRUCell`, in operators that ONNX has.

    Args:
        inputs: number of inputs.
        neurons: number of neurons.
    """

    def __init__(self, inputs: int, neurons: int) -> None:
        super().__init__()
        self.inputs = nn.Linear(inputs, 3 * neurons)
        self.recurrent = nn.Linear(neurons, 3 * neurons)

    def forward(self, values: Tensor, hidden: Tensor) -> Tensor:
        """Return the new state [N, neurons]."""
        reset, update, new = self.inputs(values).chunk(3, 1)
        old_reset, old_update, old_new = self.recurrent(hidden).chunk(3, 1)
        reset, update = (reset + old_reset).sigmoid(), (update + old_update).sigmoid()
        new = torch.tanh(new + reset * old_new)
        return new + update * (hidden - new)


class CnnGru(Recurrent):
    """PilotNet's convolutions on each frame, and a gated recurrent unit after them.

    Args:
        shape: `(channels, height, width)` of the view.
        sequence: number of frames in a window of the training.
        stride: number of rows between two frames of a window.
        activation: `elu` or `relu`.
        dropout: rates after the first convolution and before the recurrent unit.
        width: factor on the channels and units of every hidden layer.
        neurons: number of neurons of the recurrent unit.
        scale: divisor of the pixels, and the number subtracted afterwards.
    """

    def __init__(
        self,
        shape: tuple[int, int, int],
        sequence: int = 8,
        stride: int = 1,
        activation: str = "elu",
        dropout: tuple[float, float] = (0.1, 0.3),
        width: float = 1.0,
        neurons: int = 64,
        scale: tuple[float, float] = SCALE,
    ) -> None:
        super().__init__(sequence, stride)
        *rates, last = torch.linspace(*dropout, len(CONVOLUTIONS) + 1).tolist()
        self.features = convolutions(shape[0], activation, rates, width, scale)
        units = max(1, round(100 * width))
        self.dense = nn.Sequential(
            nn.Linear(feature_shape(self.features, shape, "CnnGru").numel(), units),
            activation_layer(activation),
            Dropout(last),
        )
        self.neurons = neurons
        self.cell = GruCell(units, neurons)
        self.head = nn.Linear(neurons, 1)

    def features_of(self, images: Tensor) -> Tensor:
        """Return the dense layer's outputs [N, units] for images [N, C, H, W]."""
        return self.dense(self.features(images).flatten(1))

    def next_hidden(self, features: Tensor, hidden: Tensor) -> tuple[Tensor, Tensor]:
        """Return the steering [N, 1] and the new state for one frame's features."""
        hidden = self.cell(features, hidden)
        return self.head(hidden), hidden

"""Neural circuit policy: Lechner et al., Nature Machine Intelligence 2, 2020.

"Neural circuit policies enabling auditable autonomy". Its neurons are closed-form continuous-time
cells: Hasani et al., "Closed-form continuous-time neural networks", Nature Machine Intelligence 4,
2022. The authors' package `ncps` has the same cells, and requires packages that drivezoo does not.
"""

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor, nn

from zoo.models.layers import SCALE, Normalize, feature_shape
from zoo.models.memory import Recurrent

# Convolutions before the neurons: channels, kernel, stride. The neurons see four numbers of each
# channel of the last one.
CONVOLUTIONS = [(24, 5, 2), (36, 5, 2), (48, 3, 2), (64, 3, 1), (8, 3, 1)]
FEATURES_PER_CHANNEL = 4
LAYERS = [12, 6, 1]  # inter, command and motor neurons: 19
FAN_OUT = [6, 4, 1]  # synapses of each sensor, inter and command neuron, as in the paper
WIRING_SEED = 22222


def sparse_mask(inputs: int, neurons: int, fan_out: int, rng: np.random.RandomState) -> Tensor:
    """Return a mask [neurons, inputs + neurons] of the synapses of one layer of neurons.

    Each input has synapses to `fan_out` neurons, drawn at random; a neuron without any gets the
    mean number. The neurons of a layer are all connected to each other.
    """
    mask = np.zeros((neurons, inputs), np.float32)
    for source in range(inputs):
        mask[rng.choice(neurons, fan_out, replace=False), source] = 1
    for neuron in np.flatnonzero(mask.sum(1) == 0):
        mask[neuron, rng.choice(inputs, max(1, inputs * fan_out // neurons), replace=False)] = 1
    return torch.from_numpy(np.hstack([mask, np.ones((neurons, neurons), np.float32)]))


class CfcCell(nn.Linear):
    """One layer of closed-form continuous-time neurons with sparse synapses.

    A neuron moves from one state to another at a rate of its own. All three are computed from its
    inputs. The time between two frames is constant, so that the rate needs one linear map, where
    the paper has two.

    Args:
        mask: synapses that exist, [neurons, inputs + neurons].
    """

    mask: Tensor

    def __init__(self, mask: Tensor) -> None:
        neurons, inputs = mask.shape
        super().__init__(inputs, 3 * neurons)
        self.register_buffer("mask", mask.repeat(3, 1))
        nn.init.xavier_uniform_(self.weight)

    def forward(self, inputs: Tensor) -> Tensor:
        """Return the new state [N, neurons] for values and state, [N, inputs + neurons]."""
        states = F.linear(inputs, self.weight * self.mask, self.bias)
        # Not `chunk`, after which an ONNX file does not know the sizes.
        before, after, rate = states.unflatten(1, (3, self.out_features // 3)).unbind(1)
        rate = rate.sigmoid()
        return before.tanh() * (1 - rate) + after.tanh() * rate


class Ncp(Recurrent):
    """A convolutional front, and 19 neurons with sparse synapses that steer.

    Args:
        shape: `(channels, height, width)` of the view.
        sequence: number of frames in a window of the training.
        stride: number of rows between two frames of a window.
        width: factor on the channels of all convolutions but the last.
        wiring_seed: random seed of the synapses.
        scale: divisor of the pixels, and the number subtracted afterwards.
    """

    def __init__(
        self,
        shape: tuple[int, int, int],
        sequence: int = 16,
        stride: int = 1,
        width: float = 1.0,
        wiring_seed: int = WIRING_SEED,
        scale: tuple[float, float] = SCALE,
    ) -> None:
        super().__init__(sequence, stride)
        layers: list[nn.Module] = [Normalize(scale)]
        channels = shape[0]
        for number, (out, kernel, step) in enumerate(CONVOLUTIONS, 1):
            out = out if number == len(CONVOLUTIONS) else max(1, round(out * width))
            layers += [nn.Conv2d(channels, out, kernel, step), nn.ReLU()]
            channels = out
        self.features = nn.Sequential(*layers)
        _, height, width = feature_shape(self.features, shape, "Ncp")
        count = channels * FEATURES_PER_CHANNEL
        self.sensors = nn.Conv2d(channels, count, (height, width), groups=channels)
        rng = np.random.RandomState(wiring_seed)
        masks = [
            sparse_mask(before, neurons, fan_out, rng)
            for before, neurons, fan_out in zip([count, *LAYERS[:-1]], LAYERS, FAN_OUT, strict=True)
        ]
        self.cells = nn.ModuleList(map(CfcCell, masks))
        self.neurons = sum(LAYERS)

    def features_of(self, images: Tensor) -> Tensor:
        """Return the sensors' values [N, 32] for images [N, C, H, W]."""
        return self.sensors(self.features(images)).flatten(1)

    def next_hidden(self, features: Tensor, hidden: Tensor) -> tuple[Tensor, Tensor]:
        """Return the motor neuron's state [N, 1] as the steering, and all neurons' new state."""
        states = []
        values = features
        for cell, state in zip(self.cells, hidden.split(LAYERS, 1), strict=True):
            values = cell(torch.cat([values, state], 1))
            states.append(values)
        return values, torch.cat(states, 1)

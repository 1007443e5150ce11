"""PilotNet on stacked frames, as in Mnih et al., "Human-level control ...", Nature 518, 2015.

The differences between the frames show how fast the car moves and turns.
"""

from torch import Tensor

from zoo.models.layers import SCALE
from zoo.models.memory import Stack
from zoo.models.pilotnet import PilotNet


class PilotNetStack(Stack):
    """PilotNet whose first convolution sees the frames of a window as channels.

    Args:
        shape: `(channels, height, width)` of the view.
        sequence: number of frames in a window.
        stride: number of rows between two frames of a window.
        activation, dropout, width, scale: see `zoo.models.pilotnet.PilotNet`.
    """

    def __init__(
        self,
        shape: tuple[int, int, int],
        sequence: int = 4,
        stride: int = 1,
        activation: str = "elu",
        dropout: tuple[float, float] = (0.1, 0.5),
        width: float = 1.0,
        scale: tuple[float, float] = SCALE,
    ) -> None:
        super().__init__(shape, sequence, stride)
        channels, rows, columns = shape
        stacked = (sequence * channels, rows, columns)
        self.pilotnet = PilotNet(stacked, activation, dropout, width, scale=scale)

    def outputs_of(self, stacked: Tensor) -> Tensor:
        """Return the steering [N, 1, 1] for stacked frames [N, sequence * C, H, W]."""
        return self.pilotnet(stacked)[:, None]

"""The smallest network of the zoo: steering as a weighted sum of a few pixels."""

from torch import Tensor, nn

from zoo.models.layers import Normalize


class Linear(nn.Module):
    """15 parameters at 1 x 1 x 14: one dense layer, a linear regression on a strip of road.

    Args:
        shape: `(1, rows, columns)` of the view.
    """

    takes_speed = False
    outputs = 1

    def __init__(self, shape: tuple[int, int, int]) -> None:
        super().__init__()
        colours, rows, columns = shape
        if colours != 1:
            raise ValueError("Linear looks at one channel: set model.colour=hsv_s or gray")
        self.normalize = Normalize()
        self.head = nn.Linear(rows * columns, 1)

    def forward(self, images: Tensor) -> Tensor:
        return self.head(self.normalize(images).flatten(1))

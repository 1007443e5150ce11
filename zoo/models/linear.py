"""The smallest network of the zoo: steering as a weighted sum of a few pixels."""

from torch import Tensor, nn

from zoo.models.layers import SCALE, Normalize


class Linear(nn.Module):
    """A linear regression on a strip of road: 15 parameters at 1 x 1 x 14.

    Args:
        shape: `(1, rows, columns)` of the view.
        scale: divisor of the pixels, and the number subtracted afterwards.
    """

    takes_speed = False
    outputs = 1

    def __init__(self, shape: tuple[int, int, int], scale: tuple[float, float] = SCALE) -> None:
        super().__init__()
        colours, rows, columns = shape
        if colours != 1:
            raise ValueError(
                f"Linear takes one channel, not {colours}: set model.colour=hsv_s or gray"
            )
        self.normalize = Normalize(scale)
        self.head = nn.Linear(rows * columns, 1)

    def forward(self, images: Tensor) -> Tensor:
        """Return the steering [N, 1] for images [N, 1, H, W]."""
        return self.head(self.normalize(images).flatten(1))

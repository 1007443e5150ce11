"""The smallest network of the zoo: steering as a weighted sum of a few pixels."""

from torch import nn

from zoo.models.layers import SCALE, Normalize, OneFrame


class Linear(OneFrame):
    """A linear regression on a strip of road: 15 parameters at 1 x 1 x 14.

    Args:
        shape: `(1, rows, columns)` of the view.
        scale: divisor of the pixels, and the number subtracted afterwards.
    """

    def __init__(self, shape: tuple[int, int, int], scale: tuple[float, float] = SCALE) -> None:
        super().__init__()
        colours, rows, columns = shape
        if colours != 1:
            raise ValueError(
                f"Linear takes one channel, not {colours}: set model.colour=hsv_s or gray"
            )
        self.features = Normalize(scale)
        self.head = nn.Linear(rows * columns, 1)

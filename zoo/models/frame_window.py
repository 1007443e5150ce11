"""The rows around a frame that a network with memory is trained on; without slow imports."""

from dataclasses import dataclass

from zoo.base.terminal import counted

MOST_FRAMES = 256


@dataclass(frozen=True)
class Window:
    """The rows that a network looks at and predicts.

    Attributes:
        sequence: number of frames in a window.
        stride: number of rows from one frame of a window to the next.
        ahead: number of steps after the newest frame that are predicted, `stride` rows each.

    Raises:
        ValueError: one of them is not a whole number, or out of range.

    >>> print(Window(8, 2)), print(Window(ahead=12))
    windows of 8 frames, 2 rows apart
    windows of 1 frame, and 12 steps of 1 row ahead
    (None, None)
    """

    sequence: int = 1
    stride: int = 1
    ahead: int = 0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            least = 0 if name == "ahead" else 1
            if type(value) is not int or not least <= value <= MOST_FRAMES:
                raise ValueError(
                    f"model.{name}={value!s:.100}: set a whole number from {least} to {MOST_FRAMES}"
                )

    def __str__(self) -> str:
        frames, rows = counted(self.sequence, "frame"), counted(self.stride, "row")
        apart = f", {rows} apart" if self.sequence > 1 else ""
        ahead = f", and {counted(self.ahead, 'step')} of {rows} ahead" if self.ahead else ""
        return f"windows of {frames}{apart}{ahead}"

"""Windows: the rows of a sample, with frames before its row and targets ahead of it."""

from dataclasses import dataclass, replace

import numpy as np

from datamodules.recording import Recording
from datamodules.split import PARTS, Split
from datamodules.stretches import find_breaks, missing_rows
from zoo.base.errors import InputError


@dataclass(frozen=True)
class Windows:
    """The rows of a sample.

    The window of row r has the frames of rows r - (sequence - 1) * stride, ..., r - stride, r,
    oldest first. Its targets are those of these rows and of rows r + stride, ..., r + ahead *
    stride.

    Attributes:
        sequence: number of frames, 1 or more.
        stride: rows from a frame to the next, 1 or more.
        ahead: number of targets after the newest frame, 0 or more.
    """

    sequence: int = 1
    stride: int = 1
    ahead: int = 0

    @property
    def is_windowed(self) -> bool:
        """Return whether a sample has more than one frame with its own target."""
        return self.sequence > 1 or self.ahead > 0

    @property
    def past(self) -> "Windows":
        """Return the windows without the targets ahead."""
        return replace(self, ahead=0)

    def frames(self, rows: np.ndarray) -> np.ndarray:
        """Return the rows of the frames, int64 [n, sequence]; `rows` if not windowed."""
        return self.targets(rows)[:, : self.sequence] if self.is_windowed else rows

    def targets(self, rows: np.ndarray) -> np.ndarray:
        """Return the rows of the targets, int64 [n, sequence + ahead]; `rows` if not windowed."""
        if not self.is_windowed:
            return rows
        return rows[:, None] + self.stride * np.arange(1 - self.sequence, self.ahead + 1)

    def whole(self, recording: Recording, rows: np.ndarray) -> np.ndarray:
        """Return those of the rows of a part (int64) whose window lies in that part.

        All rows from the window's first to its last are in the part, in one recording, and without
        a pause or a missing row between them.
        """
        if not self.is_windowed:
            return rows
        inside = np.zeros(len(recording), dtype=bool)
        inside[rows] = True
        borders = find_breaks(recording) | missing_rows(recording) | (inside[1:] != inside[:-1])
        run = np.concatenate([[0], np.cumsum(borders)])
        first = rows - (self.sequence - 1) * self.stride
        last = rows + self.ahead * self.stride
        fits = (first >= 0) & (last < len(recording))
        rows, first, last = rows[fits], first[fits], last[fits]
        return rows[run[first] == run[last]]

    def line(self, recording: Recording, split: Split) -> str:
        """Return a line on how many rows of each part have a window.

        Validation and test need the past frames alone.

        Raises:
            InputError: a part has rows but no window.
        """
        counts = []
        for part in PARTS:
            rows = getattr(split, part)
            whole = (self if part == "train" else self.past).whole(recording, rows)
            if len(rows) and not len(whole):
                raise InputError(
                    f"data.sequence={self.sequence} data.stride={self.stride} data.ahead="
                    f"{self.ahead}: no {part} row has a whole window in its part; set lower "
                    "values, a longer data.block_s, or record more driving"
                )
            counts.append(f"{len(whole):,} of {len(rows):,} {part}")
        ahead = f" and {self.ahead} targets ahead" if self.ahead else ""
        return (
            f"windows of {self.sequence} frames{ahead}, {self.stride} rows apart: "
            f"{', '.join(counts)} rows have one"
        )


SINGLE_FRAMES = Windows()

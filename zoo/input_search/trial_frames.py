"""Frames of a recording on which combinations are tried, decoded once."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from datamodules.image import FRAME_HEIGHT, FRAME_WIDTH, read_image
from datamodules.recording import Recording
from zoo.base.errors import InputError

MOVING_MPH = 1.0
BEND = 0.05  # least |steering| of a row that shows which way the road bends
LEAST_ROWS = 60


@dataclass(frozen=True)
class TrialFrames:
    """Frames with their recorded steering, in the order of driving.

    Attributes:
        center: frames uint8 [N, 160, 320, 3] RGB.
        left, right: frames of the side cameras at the same rows; [0, 160, 320, 3] without them.
        steering: recorded steering, -1..1, float64 [N].
    """

    center: np.ndarray
    left: np.ndarray
    right: np.ndarray
    steering: np.ndarray

    def every(self, step: int) -> "TrialFrames":
        """Return every `step`-th row."""
        rows = slice(None, None, step)
        return TrialFrames(
            self.center[rows], self.left[rows], self.right[rows], self.steering[rows]
        )

    def center_only(self) -> "TrialFrames":
        """Return the frames without the side cameras."""
        return TrialFrames(self.center, self.left[:0], self.right[:0], self.steering)


def choose_rows(recording: Recording, count: int) -> np.ndarray:
    """Return at most `count` rows in bends, evenly spread over the recording, int64.

    Raises:
        InputError: the car moves and steers in too few rows.
    """
    moving = recording.speed_mph > MOVING_MPH
    rows = np.flatnonzero(moving & (np.abs(recording.steering) >= BEND))
    if len(rows) < LEAST_ROWS:
        raise InputError(
            f"{', '.join(recording.names)}: only {len(rows)} of {len(recording)} rows move and "
            f"steer by {BEND:g} or more, {LEAST_ROWS} are needed to find the input; name a longer "
            "recording, with bends"
        )
    return rows[np.unique(np.linspace(0, len(rows) - 1, count).round().astype(int))]


def read_trial_frames(
    recording: Recording, count: int, show: Callable[[float], None] = lambda share: None
) -> TrialFrames:
    """Decode the images of at most `count` rows.

    Args:
        recording: recording in the order of driving.
        count: most rows.
        show: function called with the finished share of the work, 0..1.

    Raises:
        InputError: an image cannot be read, or see `choose_rows`.
    """
    rows = choose_rows(recording, count)
    has_sides = all(path is not None for path in recording.images[rows].flat)
    frames = np.empty((3 if has_sides else 1, len(rows), FRAME_HEIGHT, FRAME_WIDTH, 3), np.uint8)
    for place, row in enumerate(rows):
        for camera, images in enumerate(frames):
            path = recording.images[row, camera]
            try:
                images[place] = read_image(path)
            except (OSError, ValueError) as error:
                raise InputError(
                    f"{recording.place(row)}: {path}: {error}; copy the image again, or name "
                    "another recording"
                ) from None
        show((place + 1) / len(rows))
    left, right = frames[1:] if has_sides else (frames[0][:0], frames[0][:0])
    return TrialFrames(frames[0], left, right, recording.steering[rows])

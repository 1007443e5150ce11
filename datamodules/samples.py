"""Samples: each is a row and one of its cameras, with steering corrected for the camera."""

from dataclasses import dataclass

import numpy as np

from datamodules.driving_log import CAMERAS
from datamodules.errors import InputError
from datamodules.recording import Recording
from datamodules.windows import SINGLE_FRAMES, Windows

CENTER, LEFT, RIGHT = range(3)

# Measured on the original simulator: cameras' metres from the centreline, wheelbase, steering lock.
CAMERA_OFFSET_M = {LEFT: -0.806, RIGHT: 0.825}
WHEELBASE_M = 2.87
MAX_STEERING_DEG = 25.0
MPS_PER_MPH = 0.44704
MIN_RECOVERY_M = 4.0


@dataclass(frozen=True)
class Samples:
    """Columns of M samples.

    Attributes:
        row: recording's row, int64 [M].
        camera: 0 center, 1 left, 2 right, int64 [M].
        steering: steering corrected for the camera, -1..1, float32 [M].
        throttle: throttle minus brake, -1..1, float32 [M].
        speed_mph: speed, float32 [M].
        flipped: whether to mirror the sample before all else, bool [M] (`steering` is not yet
            negated).
    """

    row: np.ndarray
    camera: np.ndarray
    steering: np.ndarray
    throttle: np.ndarray
    speed_mph: np.ndarray
    flipped: np.ndarray

    def __len__(self) -> int:
        return len(self.row)

    def frames(self, numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the rows and the cameras of samples' frames, int64 [n] each."""
        return self.row[numbers], self.camera[numbers]

    def labels(self, numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the steering and the throttle of samples, float32 [n] each."""
        return self.steering[numbers], self.throttle[numbers]


@dataclass(frozen=True)
class WindowSamples(Samples):
    """Samples with a window of rows each; the columns are those of its newest frame's row.

    Attributes:
        windows: rows of a sample.
        row_steering: steering of all rows, corrected for each camera, float32 [N, 3].
        row_throttle: throttle minus brake of all rows, float32 [N].
    """

    windows: Windows
    row_steering: np.ndarray
    row_throttle: np.ndarray

    def frames(self, numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the frames' rows, int64 [n, sequence], and their cameras, int64 [n, 1]."""
        return self.windows.frames(self.row[numbers]), self.camera[numbers][:, None]

    def labels(self, numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the steering and the throttle, float32 [n, sequence + ahead] each."""
        rows = self.windows.targets(self.row[numbers])
        return self.row_steering[rows, self.camera[numbers][:, None]], self.row_throttle[rows]


def make_samples(
    recording: Recording,
    rows: np.ndarray,
    cameras: list[str],
    offset: float = 0.0,
    recover_s: float | None = None,
    both_ways: bool = False,
    windows: Windows = SINGLE_FRAMES,
) -> Samples:
    """Return a sample for each row and each of its recorded cameras.

    Args:
        recording: recording of all rows.
        rows: row numbers, int64; their windows are whole (see `Windows.whole`).
        cameras: names of the cameras to use.
        offset: steering added to left images and subtracted from right ones.
        recover_s: seconds in which the side camera returns to the centreline; derives the
            correction from the rig and each row's speed, in place of `offset`.
        both_ways: whether to add each sample a second time, mirrored.
        windows: rows of a sample; each frame must have an image of the sample's camera.

    Raises:
        InputError: a camera is unknown, or no row has an image of these cameras.
    """
    if not cameras or any(name not in CAMERAS for name in cameras):
        raise InputError(f"data.cameras={cameras} is not a list of {', '.join(CAMERAS)}")
    row_steering = np.full((len(recording), len(CAMERAS)), np.nan, np.float32)
    parts = []
    for number in sorted(CAMERAS.index(name) for name in set(cameras)):
        has_image = np.array([image is not None for image in recording.images[:, number]], bool)
        in_frames = has_image[windows.frames(rows)]
        seen = rows[in_frames.all(axis=tuple(range(1, in_frames.ndim)))]
        correction: float | np.ndarray = {CENTER: 0.0, LEFT: offset, RIGHT: -offset}[number]
        if recover_s is not None and number != CENTER:
            offset_m = CAMERA_OFFSET_M[number]
            correction = recovery_steering(offset_m, recording.speed_mph, recover_s)
        row_steering[:, number] = np.clip(recording.steering + correction, -1, 1)
        parts.append((seen, np.full(len(seen), number)))
    row, camera = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    if not len(row):
        raise InputError(f"no row has an image of data.cameras={cameras}; name another camera")
    order = np.lexsort((camera, row))
    flipped = np.zeros(len(row), dtype=bool)
    if both_ways:
        order = np.concatenate([order, order])
        flipped = np.arange(len(order)) >= len(row)
    row, camera = row[order], camera[order]
    row_throttle = (recording.throttle - recording.brake).astype(np.float32)
    columns = {
        "row": row,
        "camera": camera,
        "steering": row_steering[row, camera],
        "throttle": row_throttle[row],
        "speed_mph": recording.speed_mph[row].astype(np.float32),
        "flipped": flipped,
    }
    if not windows.is_windowed:
        return Samples(**columns)
    return WindowSamples(
        **columns, windows=windows, row_steering=row_steering, row_throttle=row_throttle
    )


def recovery_steering(
    offset_m: float, speed_mph: np.ndarray | float, recover_s: float
) -> np.ndarray:
    """Return the steering (-1..1) that returns a car to its line in `recover_s` seconds.

    The car is `offset_m` right of the line. Its arc meets the line at the distance driven in that
    time (pure pursuit: Coulter, "Implementation of the Pure Pursuit Path Tracking Algorithm",
    1992), by the bicycle model. A nearly standing car gets the arc of 4 m.

    >>> float(recovery_steering(-0.806, 9.0, 2.0).round(3))
    0.162
    """
    distance = np.maximum(np.asarray(speed_mph) * MPS_PER_MPH * recover_s, MIN_RECOVERY_M)
    curvature = -2 * offset_m / (distance**2 + offset_m**2)
    steering_deg = np.degrees(np.arctan(WHEELBASE_M * curvature))
    return np.clip(steering_deg / MAX_STEERING_DEG, -1, 1)

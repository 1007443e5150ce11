"""Samples: each is a row, or a window of rows, and a camera, with steering corrected for it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from datamodules.driving_log import CAMERAS
from datamodules.recording import Recording
from datamodules.split import recording_rates
from datamodules.steering_label import in_label
from datamodules.windows import SINGLE_FRAMES, Windows
from zoo.base.errors import InputError, UsageError
from zoo.base.rig import MPS_PER_MPH, STEERING, Rig, SteeringLabel

CENTER, LEFT, RIGHT = range(3)
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
        windows: rows of a sample; the columns are those of its newest frame's row.
        row_rate: rows of a second in the recording of each row, float64 [rows].
        row_steering: recorded steering of all rows, float64 [N].
        row_correction: steering that each camera adds, float64 [N, 3].
        row_recovery_m: distance in which each camera's correction leads back to the line, float64
            [N, 3]; 1 where there is no correction.
        row_throttle: throttle minus brake of all rows, float32 [N].
    """

    row: np.ndarray
    camera: np.ndarray
    steering: np.ndarray
    throttle: np.ndarray
    speed_mph: np.ndarray
    flipped: np.ndarray
    windows: Windows
    row_rate: np.ndarray
    row_steering: np.ndarray
    row_correction: np.ndarray
    row_recovery_m: np.ndarray
    row_throttle: np.ndarray

    def __len__(self) -> int:
        return len(self.row)

    def frames(self, numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the rows and the cameras of samples' frames, int64 [n] each.

        With windows, rows are int64 [n, sequence], and cameras [n, 1].
        """
        camera = self.camera[numbers]
        cameras = camera[:, None] if self.windows.is_windowed else camera
        return self.windows.frames(self.row[numbers]), cameras

    def labels(self, numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the steering and the throttle of samples, float32 [n] each.

        With windows, they are float32 [n, sequence + ahead]. The frames are seen from the side
        camera's place, and get its whole correction. In the steps ahead a car that started there
        returns to the line (see `recovery_course`).
        """
        if not self.windows.is_windowed:
            return self.steering[numbers], self.throttle[numbers]
        rows = self.windows.targets(self.row[numbers])
        row, camera = self.row[numbers], self.camera[numbers]
        correction = self.row_correction[rows, camera[:, None]]
        newest = self.windows.sequence - 1
        steps = self.windows.stride * np.arange(self.windows.ahead + 1)
        correction[:, newest:] = recovery_course(
            self.row_recovery_m[row, camera],
            correction[:, newest],
            self.speed_mph[numbers],
            steps / self.row_rate[row][:, None],
        )
        steering = np.clip(self.row_steering[rows] + correction, -1, 1)
        return steering.astype(np.float32), self.row_throttle[rows]


def make_samples(
    recording: Recording,
    rows: np.ndarray,
    cameras: list[str],
    offset: float = 0.0,
    recover_s: float | None = None,
    both_ways: bool = False,
    windows: Windows = SINGLE_FRAMES,
    label: SteeringLabel = STEERING,
) -> Samples:
    """Return a sample for each row and each of its recorded cameras.

    Args:
        recording: recording of all rows, whose steering is in the unit of `label`.
        rows: row numbers, int64; their windows are whole (see `Windows.whole`).
        cameras: names of the cameras to use.
        offset: steering added to left images and subtracted from right ones.
        recover_s: seconds in which the side camera returns to the centreline; derives the
            correction from the rig and each row's speed, in place of `offset`.
        both_ways: whether to add each sample a second time, mirrored.
        windows: rows of a sample; each frame must have an image of the sample's camera.
        label: what the recording's steering means; side cameras add as much of it.

    Raises:
        InputError: a camera is unknown, or no row has an image of these cameras.
        UsageError: the place of a side camera is unknown, and `recover_s` or targets ahead need it.
    """
    row_correction = np.zeros((len(recording), len(CAMERAS)))
    row_recovery_m = np.ones_like(row_correction)
    parts = []
    for number in camera_numbers(cameras):
        has_image = np.array([image is not None for image in recording.images[:, number]], bool)
        in_frames = has_image[windows.frames(rows)]
        seen = rows[in_frames.all(axis=tuple(range(1, in_frames.ndim)))]
        correction = np.full(len(recording), {CENTER: 0.0, LEFT: offset, RIGHT: -offset}[number])
        if number != CENTER and recover_s is not None:
            for rig_rows, rig, right_m in _side_cameras(recording, seen, number, "data.recover_s"):
                speed_mph = recording.speed_mph[rig_rows]
                correction[rig_rows] = recovery_steering(right_m, speed_mph, recover_s, rig)
        row_correction[:, number] = in_label(recording, correction, label)
        if number != CENTER and windows.ahead:
            for rig_rows, rig, right_m in _side_cameras(recording, seen, number, "data.ahead"):
                curvature = label.curvature(row_correction[rig_rows, number], rig)
                row_recovery_m[rig_rows, number] = recovery_distance(right_m, curvature)
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
    steering = np.clip(recording.steering[row] + row_correction[row, camera], -1, 1)
    return Samples(
        row=row,
        camera=camera,
        steering=steering.astype(np.float32),
        throttle=row_throttle[row],
        speed_mph=recording.speed_mph[row].astype(np.float32),
        flipped=flipped,
        windows=windows,
        row_rate=np.array(recording_rates(recording))[recording.recording],
        row_steering=recording.steering,
        row_correction=row_correction,
        row_recovery_m=row_recovery_m,
        row_throttle=row_throttle,
    )


def camera_numbers(cameras: Sequence[str]) -> list[int]:
    """Return the numbers of cameras, sorted.

    Raises:
        InputError: a camera is unknown or named twice, or there is none.
    """
    named = cameras if isinstance(cameras, list | tuple) else ()
    numbers = [number for number, name in enumerate(CAMERAS) if name in named]
    if not numbers or len(numbers) != len(named):
        raise InputError(f"data.cameras={cameras} is not a list of {', '.join(CAMERAS)}, each once")
    return numbers


def _side_cameras(
    recording: Recording, seen: np.ndarray, camera: int, key: str
) -> Iterator[tuple[np.ndarray, Rig, float]]:
    """Yield a recording's rows, bool [N], its rig, and a side camera's metres to the right.

    Args:
        recording: one or several recordings; those without an image of this camera are left out.
        seen: rows with an image of this camera.
        camera: number of the side camera.
        key: key that needs its place, for messages.
    """
    side = CAMERAS[camera]
    for number in np.unique(recording.recording[seen]).tolist():
        rig = recording.each_rig[number]
        if rig is None or side not in rig.cameras:
            raise UsageError(
                f"{recording.names[number]}: {key} needs the place of the {side} camera; write "
                'side_m to rig.yaml in this folder, or set "data.cameras=[center]"'
            )
        yield recording.recording == number, rig, rig.cameras[side].right_m


def recovery_steering(
    offset_m: float, speed_mph: np.ndarray | float, recover_s: float, rig: Rig
) -> np.ndarray:
    """Return the steering (-1..1) that returns a car to its line in `recover_s` seconds.

    The car is `offset_m` right of the line. Its arc meets the line at the distance driven in that
    time (pure pursuit: Coulter, "Implementation of the Pure Pursuit Path Tracking Algorithm",
    1992), by the bicycle model. A nearly standing car gets the arc of 4 m.

    >>> from zoo.base.rig import UDACITY
    >>> float(recovery_steering(-0.806, 9.0, 2.0, UDACITY).round(3))
    0.162
    """
    distance = np.maximum(np.asarray(speed_mph) * MPS_PER_MPH * recover_s, MIN_RECOVERY_M)
    return np.clip(rig.steering_of(-2 * offset_m / (distance**2 + offset_m**2)), -1, 1)


def recovery_distance(offset_m: float, curvature: np.ndarray) -> np.ndarray:
    """Return the distance in which an arc meets the line, metres [n]; see `recovery_steering`.

    Args:
        offset_m: metres to the right of the line.
        curvature: of the arc, 1/m, with any sign [n].
    """
    curvature = np.abs(curvature)
    squared = 2 * abs(offset_m) / np.where(curvature == 0, 1, curvature) - offset_m**2
    return np.sqrt(np.maximum(squared, offset_m**2))


def recovery_course(
    distance_m: np.ndarray, steering: np.ndarray, speed_mph: np.ndarray, seconds: np.ndarray
) -> np.ndarray:
    """Return the steering on the way back to the line, of a car that follows it by pure pursuit.

    To first order the distance y from the line, at the position x on it, follows y'' = -2 (y + d
    y') / d**2. From y' = 0 the curvature is its first value times exp(-x / d) (cos(x / d) -
    sin(x / d)): the car steers back until 0.8 d, and then a little the other way.

    Args:
        distance_m: distance d in which the first arc meets the line, see `recovery_distance` [n].
        steering: steering, or its label, at the start, -1..1 [n].
        speed_mph: constant speeds [n].
        seconds: times after the start [K], or those of each [n, K].

    Returns:
        Steering [n, K].

    >>> recovery_course(np.array([6.0]), np.array([0.3]), np.array([15.0]), np.array([0, 0.4]))
    array([[0.3       , 0.09006318]])
    """
    way = (np.maximum(speed_mph, 0) * MPS_PER_MPH / distance_m)[:, None] * seconds
    return steering[:, None] * np.exp(-way) * (np.cos(way) - np.sin(way))

"""Rows of a recording that are worth a look: the sharpest bends, jumps, and frames that differ."""

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.ndimage import median_filter

from datamodules.image import AnyImage, decode_image, read_stored
from datamodules.recording import Recording
from datamodules.split import rows_per_second
from datamodules.stretches import find_breaks, true_runs

MOST_ROWS = 40  # rows of each kind
APART_S = 2.0  # least time between two rows of a kind
SMOOTHED_S = 0.5  # a bend is steered longer than a correction
LEAST_STEERING = 0.02  # smaller bends, jumps and errors are not listed
LEAST_SPEED_MPH = 1.0
FEWEST_AROUND = 15  # rows on each side that a frame's difference is compared with
LEAST_RATIO = 2.0  # difference of an odd frame from both neighbours, over the usual one
THUMBNAIL = (40, 20)  # pixels, width and height


@dataclass(frozen=True)
class NotableRow:
    """A row and how notable it is, in the unit of its kind."""

    row: int
    value: float


def sharpest_bends(recording: Recording) -> list[NotableRow]:
    """Return the rows in the middle of the sharpest bends; values are the mean steering, -1..1."""
    rows = max(1, round(SMOOTHED_S * rows_per_second(recording)))
    smooth = np.convolve(recording.steering, np.ones(rows) / rows, "same")
    return _strongest(recording, np.abs(smooth), LEAST_STEERING, smooth)


def steering_jumps(recording: Recording) -> list[NotableRow]:
    """Return the rows with the largest change of steering since the row before."""
    change = np.zeros(len(recording))
    change[1:] = np.where(find_breaks(recording), 0, np.diff(recording.steering))
    return _strongest(recording, np.abs(change), LEAST_STEERING, change)


def standstills(recording: Recording) -> list[NotableRow]:
    """Return the first rows of the longest standstills; values are numbers of rows."""
    still = true_runs(recording.known_speed_mph < LEAST_SPEED_MPH)
    longest = sorted(still, key=lambda run: run[0] - run[1])[:MOST_ROWS]
    return [NotableRow(first, float(end - first)) for first, end in longest]


def odd_frames(recording: Recording, differences: np.ndarray) -> list[NotableRow]:
    """Return the frames that differ most from both neighbours, which alone are alike.

    A value is the smaller of a frame's two differences over the median of the rows around it: a
    bend or a bridge changes many frames in a row, a damaged or foreign frame only one. An image
    that cannot be read has the value infinity.

    Args:
        recording: recording of the frames.
        differences: see `frame_difference`, of each row from the row before; NaN where unknown,
            infinity for a row whose image cannot be read; float [N].
    """
    before = np.where(np.isfinite(differences), differences, np.nan)
    before[1:][find_breaks(recording)] = np.nan
    after = np.append(before[1:], np.nan)
    alone = np.fmin(before, after)
    alone[np.isnan(before) | np.isnan(after)] = np.nan
    usual = _running_median(before, max(FEWEST_AROUND, round(rows_per_second(recording))))
    ratio = np.nan_to_num(alone / np.maximum(usual, 1.0))
    ratio[np.isposinf(differences)] = np.inf
    return _strongest(recording, ratio, LEAST_RATIO, ratio)


def largest_errors(recording: Recording, predicted: np.ndarray) -> list[NotableRow]:
    """Return the rows with the largest difference of predicted and recorded steering.

    Args:
        recording: recording with the steering.
        predicted: predicted steering, float [N]; NaN where unknown.
    """
    error = np.nan_to_num(predicted - recording.steering)
    return _strongest(recording, np.abs(error), LEAST_STEERING, error)


def thumbnail(image: AnyImage) -> np.ndarray:
    """Return a small grey image, uint8 [20, 40]: decoding to it takes half of the usual time.

    Raises:
        OSError: the file cannot be read.
        ValueError: it is no whole JPEG or PNG.
    """
    stored = read_stored(image)
    if isinstance(stored, bytes):
        small = decode_image(stored, cv2.IMREAD_REDUCED_GRAYSCALE_8)
    else:
        small = cv2.cvtColor(stored, cv2.COLOR_RGB2GRAY)
    return cv2.resize(small, THUMBNAIL, interpolation=cv2.INTER_AREA)


def frame_difference(first: np.ndarray, second: np.ndarray) -> float:
    """Return the mean difference of two thumbnails' pixels, 0..255."""
    return float(cv2.absdiff(first, second).mean())


def _strongest(
    recording: Recording, strength: np.ndarray, least: float, values: np.ndarray
) -> list[NotableRow]:
    """Return the rows of largest strength, of which no two are within `APART_S`."""
    apart = max(1, round(APART_S * rows_per_second(recording)))
    free = strength >= least
    notable: list[NotableRow] = []
    for row in np.argsort(-strength, kind="stable"):
        if len(notable) == MOST_ROWS or strength[row] < least:
            break
        if free[row]:
            notable.append(NotableRow(int(row), float(values[row])))
            free[max(0, row - apart + 1) : row + apart] = False
    return notable


def _running_median(values: np.ndarray, around: int) -> np.ndarray:
    """Return the median of the rows around each row; unknown rows count as the median of all."""
    finite = ~np.isnan(values)
    if not finite.any():
        return np.zeros(len(values))
    return median_filter(np.where(finite, values, np.median(values[finite])), 2 * around + 1)

"""Whether a positive steering turns right, as a recording's images show."""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from datamodules.recording import Recording
from datamodules.stretches import find_breaks

PAIRS = 400  # of neighbouring images that are compared, at most
FORWARD_ROWS = 2_000  # first rows from which they come where images can only be read in order
SMALL = (160, 80)  # size in which images are compared
LEAST_PAIRS = 40
LEAST_CORRELATION, MOST_CHANCE = 0.15, 0.02  # of a correlation that settles the sign


@dataclass(frozen=True)
class SignEvidence:
    """How a steering goes together with the images' motion.

    While a car turns right, what is far ahead moves to the left from one image to the next.

    Attributes:
        correlation: Spearman's, of the steering with the turn to the right; NaN without enough
            images that differ.
        chance: share of the same steering's shifts in time whose correlation is as strong.
        pairs: number of pairs of images.
    """

    correlation: float
    chance: float
    pairs: int

    @property
    def is_clear(self) -> bool:
        """Return whether the images settle the sign."""
        return abs(self.correlation) >= LEAST_CORRELATION and self.chance <= MOST_CHANCE

    @property
    def is_exchanged(self) -> bool:
        """Return whether the images show that a positive steering turns left."""
        return self.is_clear and self.correlation < 0

    def words(self) -> str:
        """Return the evidence in words."""
        if math.isnan(self.correlation):
            return "the images do not move enough to tell left from right"
        return (
            f"correlation {self.correlation:+.2f} with the turn to the right that {self.pairs} "
            "pairs of images show"
        )


def find_sign_evidence(recording: Recording) -> SignEvidence:
    """Compare the steering with the motion between neighbouring images of the centre camera.

    The motion is the phase correlation of the upper halves, which show what is far away.
    """
    rows = _pairs(recording)
    turns = np.array([_turn(recording, row) for row in rows])
    steering = recording.steering[rows]
    finite = ~np.isnan(turns)
    steering, turns = steering[finite], turns[finite]
    if len(turns) < LEAST_PAIRS or not np.ptp(steering) or not np.ptp(turns):
        return SignEvidence(math.nan, 1.0, len(turns))
    first, second = _ranks(steering), _ranks(turns)
    # All shifts in time at once; a shift keeps how slowly a steering changes.
    all_shifts = np.fft.irfft(np.fft.rfft(second) * np.conj(np.fft.rfft(first)), len(first))
    correlations = all_shifts / len(first)
    margin = len(first) // 20
    shifted = np.abs(correlations[margin : len(first) - margin])
    chance = (1 + np.sum(shifted >= abs(correlations[0]))) / (1 + len(shifted))
    return SignEvidence(float(correlations[0]), float(chance), len(turns))


def sign_line(name: str, evidence: SignEvidence) -> str:
    """Return a line on whether a recording's images agree with its steering's sign."""
    agreement = "left and right fit the images"
    if not evidence.is_clear:
        agreement = "the images do not settle left and right"
    elif evidence.is_exchanged:
        agreement = "LEFT AND RIGHT SEEM EXCHANGED: name the sign with data.steering="
    return f"{name}: {agreement}; {evidence.words()}"


def _pairs(recording: Recording) -> np.ndarray:
    """Return rows whose next row shows the same drive a moment later."""
    in_files = isinstance(recording.images[0, 0], str)
    last = len(recording) - 1 if in_files else min(len(recording) - 1, FORWARD_ROWS)
    rows = np.flatnonzero(~find_breaks(recording)[:last])
    return rows[np.unique(np.linspace(0, len(rows) - 1, min(PAIRS, len(rows))).astype(int))]


def _turn(recording: Recording, row: int) -> float:
    """Return the turn to the right between two rows' images, pixels of `SMALL`; NaN if unknown."""
    try:
        halves = [_far_half(recording.image(at)) for at in (row, row + 1)]
    except (OSError, ValueError):
        return math.nan
    window = cv2.createHanningWindow(halves[0].shape[::-1], cv2.CV_32F)
    (right_px, _), _ = cv2.phaseCorrelate(halves[0], halves[1], window)
    return -right_px


def _far_half(image: np.ndarray) -> np.ndarray:
    small = cv2.resize(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), SMALL, interpolation=cv2.INTER_AREA)
    return small[: SMALL[1] // 2].astype(np.float32)


def _ranks(values: np.ndarray) -> np.ndarray:
    """Return ranks, equal values sharing theirs, of mean 0 and deviation 1."""
    _, inverse, counts = np.unique(values, return_inverse=True, return_counts=True)
    ranks = (np.cumsum(counts) - (counts - 1) / 2)[inverse]
    return (ranks - ranks.mean()) / ranks.std()

"""A stretch of a recording in which whoever drove comes back to the middle."""

from dataclasses import dataclass

import numpy as np

from datamodules.recording import GAP_S, Recording
from datamodules.split import rows_per_second
from zoo.reporting.blocks import MissingError

STRETCH_S = 3.0
SLOWEST_MPH = 3.0
LEAST_CHANGE = 0.05  # of the steering: less is no recovery


@dataclass(frozen=True)
class Recovery:
    """Rows of a recording (int64 [n], one after another), and how they were chosen."""

    rows: np.ndarray
    why: str


def find_recovery(recording: Recording) -> Recovery:
    """The likeliest recovery of a recording, which does not say how far off the middle the car was.

    Who records recoveries stops recording on the way out, and begins when the car is to come back:
    so first the stretches right after a pause are looked at, then all. The one counts whose
    steering comes back the furthest: the largest |steering| in its first half, less the mean of its
    last quarter.

    Raises:
        MissingError: nothing is long enough, or the steering hardly changes anywhere.
    """
    length = max(4, round(STRETCH_S * rows_per_second(recording)))
    starts, after_pause = _starts(recording, length)
    if not len(starts):
        raise MissingError(f"No stretch of the recording lasts {STRETCH_S:g} s without a pause.")
    for chosen, of in (
        (starts[after_pause], "the stretches that follow a pause in the recording"),
        (starts, "all its stretches"),
    ):
        best, change = _best(recording, chosen, length)
        if best is None or change < LEAST_CHANGE:
            continue
        why = (
            "The log does not say how far off the middle the car was. Of "
            f"{of} ({len(chosen):,} of {STRETCH_S:g} s), this is the one whose steering comes back "
            f"the furthest, by {change:.2f}."
        )
        if chosen is starts:
            why += " No pause came before a recovery, so it may be a sharp bend."
        return Recovery(np.arange(best, best + length), why)
    raise MissingError("The steering hardly changes anywhere in the recording.")


def _starts(recording: Recording, length: int) -> tuple[np.ndarray, np.ndarray]:
    """First rows (int64 [n]) of stretches of so many rows without a pause or standstill, and
    whether each follows a pause (bool [n])."""
    steps = np.diff(recording.time_s)
    # Where no time is known, nothing tells of a pause.
    paused = np.isfinite(steps) & ((steps > GAP_S) | (steps < 0))
    other = np.diff(recording.recording) != 0
    broken = np.concatenate([[0], np.cumsum(paused | other)])
    starts = np.arange(max(len(recording) - length + 1, 0))
    starts = starts[broken[starts] == broken[starts + length - 1]]
    slow = np.concatenate([[0], np.cumsum(recording.speed_mph < SLOWEST_MPH)])
    starts = starts[slow[starts + length] == slow[starts]]
    follows = np.concatenate([[False], paused & ~other])
    return starts, follows[starts]


def _best(recording: Recording, starts: np.ndarray, length: int) -> tuple[int | None, float]:
    if not len(starts):
        return None, 0.0
    steering = np.abs(recording.steering)[starts[:, None] + np.arange(length)]
    change = steering[:, : length // 2].max(1) - steering[:, -max(1, length // 4) :].mean(1)
    return int(starts[change.argmax()]), float(change.max())

"""Find a stretch of a recording in which the car returns to the centreline."""

from dataclasses import dataclass

import numpy as np

from datamodules.recording import Recording
from datamodules.stretches import LEAST_CHANGE, STRETCH_S, find_stretches, steering_returns
from zoo.report.blocks import MissingError


@dataclass(frozen=True)
class Recovery:
    """Consecutive rows of a recording (int64 [n]), and a text on how they were chosen."""

    rows: np.ndarray
    why: str


def find_recovery(recording: Recording) -> Recovery:
    """Return the most likely recovery of a recording, which holds no cross-track error.

    A driver who records recoveries pauses the recording on the way to the lane's edge, and resumes
    it for the way back. So search the stretches right after a pause first, then all stretches. The
    chosen stretch has the largest recovery response: the largest |steering| in its first half minus
    the mean of its last quarter.

    Raises:
        MissingError: no stretch is long enough, or the steering hardly changes in all of them.
    """
    stretches = find_stretches(recording)
    starts, length = stretches.first, stretches.length
    if not len(starts):
        raise MissingError(f"No stretch of the recording lasts {STRETCH_S:g} s without a pause.")
    for chosen, which in (
        (starts[stretches.after_pause], " that follow a pause in the recording"),
        (starts, " of the recording"),
    ):
        best, change = _best(recording, chosen, length)
        if best is None or change < LEAST_CHANGE:
            continue
        why = (
            f"This is the largest recovery response in the stretches of {STRETCH_S:g} s{which} "
            f"(number: {len(chosen):,}): the steering returns by {change:.2f}. The log does not "
            "contain the cross-track error."
        )
        if chosen is starts:
            why += " No recovery follows a pause, so this may be a sharp bend."
        return Recovery(np.arange(best, best + length), why)
    raise MissingError("The steering hardly changes anywhere in the recording.")


def _best(recording: Recording, starts: np.ndarray, length: int) -> tuple[int | None, float]:
    if not len(starts):
        return None, 0.0
    change = steering_returns(recording, starts, length)
    return int(starts[change.argmax()]), float(change.max())

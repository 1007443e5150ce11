"""A stretch of a recording in which whoever drove comes back to the middle."""

from dataclasses import dataclass

import numpy as np

from datamodules.recording import Recording
from datamodules.stretches import LEAST_CHANGE, STRETCH_S, find_stretches, steering_returns
from zoo.report.blocks import MissingError


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
    stretches = find_stretches(recording)
    starts, length = stretches.first, stretches.length
    if not len(starts):
        raise MissingError(f"No stretch of the recording lasts {STRETCH_S:g} s without a pause.")
    for chosen, of in (
        (starts[stretches.after_pause], "the stretches that follow a pause in the recording"),
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


def _best(recording: Recording, starts: np.ndarray, length: int) -> tuple[int | None, float]:
    if not len(starts):
        return None, 0.0
    change = steering_returns(recording, starts, length)
    return int(starts[change.argmax()]), float(change.max())

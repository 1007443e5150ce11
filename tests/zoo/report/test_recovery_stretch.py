"""The stretch of a recording that is shown as a recovery."""

from dataclasses import replace

import numpy as np
import pytest

from datamodules.recording import Recording
from datamodules.stretches import STRETCH_S
from tests.recordings import FPS, recording_in_memory
from zoo.base.errors import InputError
from zoo.report.data_section import find_recovery

LENGTH = round(STRETCH_S * FPS)
BEND, BACK = 60, 200  # rows where a sharp bend and a recovery begin


def driven(pause: bool) -> Recording:
    """Return a recording with a sharp bend, then a recovery, with or without a pause before it."""
    steering = np.zeros(300)
    steering[BEND : BEND + 20] = 0.8
    steering[BACK : BACK + 15] = np.linspace(-0.4, 0, 15)
    recording = recording_in_memory(steering)
    time = recording.time_s.copy()
    time[BACK:] += 5.0 if pause else 0.0
    return replace(recording, time_s=time)


def test_a_recovery_after_a_pause_goes_before_a_sharper_bend() -> None:
    rows, why = find_recovery(driven(pause=True))
    assert rows.tolist() == list(range(BACK, BACK + LENGTH))
    assert "follow a pause" in why
    assert "0.40" in why


def test_without_a_pause_the_largest_return_is_shown_with_a_warning() -> None:
    rows, why = find_recovery(driven(pause=False))
    assert BEND in rows
    assert BACK not in rows
    assert "may be a sharp bend" in why


def test_a_stretch_never_crosses_a_pause_or_another_recording() -> None:
    steering = np.zeros(200)
    steering[80:110] = 0.9
    recording = recording_in_memory(steering, sizes=(100, 100))
    rows, _ = find_recovery(recording)
    assert len(set(recording.recording[rows])) == 1


@pytest.mark.parametrize(
    ("rows", "steering", "words"),
    [(20, 0.5, "No stretch of the recording lasts"), (200, 0.3, "hardly changes")],
)
def test_a_missing_recovery_has_a_reason(rows: int, steering: float, words: str) -> None:
    with pytest.raises(InputError, match=words):
        find_recovery(recording_in_memory(np.full(rows, steering)))


def test_standing_still_is_no_recovery() -> None:
    steering = np.zeros(200)
    steering[100:120] = 1.0
    with pytest.raises(InputError, match="No stretch"):
        find_recovery(recording_in_memory(steering, speed_mph=0.0))

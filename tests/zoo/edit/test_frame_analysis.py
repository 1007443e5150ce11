"""The analysis of frames in the background."""

import time

import numpy as np

from datamodules.recording_format import read_recordings
from tests.recordings import Written
from zoo.checkpoints.command import Command, Policy
from zoo.edit.edit_session import FrameAnalysis


class Counting(Policy):
    """A policy with a memory: it steers by the number of frames since its last reset."""

    def __init__(self) -> None:
        self.frames = 0

    def __call__(self, frame: np.ndarray, speed_mph: float) -> Command:
        self.frames += 1
        return Command(self.frames / 1000)

    def reset(self) -> None:
        self.frames = 0


def test_every_row_is_analysed_in_order_by_a_policy_with_memory(recorded: Written) -> None:
    recording = read_recordings(str(recorded.folder))
    analysis = FrameAnalysis(recording, Counting())
    analysis.start()
    ends = time.monotonic() + 60
    while analysis.done < len(recording):
        assert time.monotonic() < ends
        time.sleep(0.02)
    analysis.stop()
    rows, predicted = analysis.predicted_after(20)
    assert rows.tolist() == list(range(20, len(recording)))
    np.testing.assert_allclose(predicted, np.arange(20, len(recording)) / 1000 + 0.001)
    assert np.isfinite(analysis._differences[1:]).all()

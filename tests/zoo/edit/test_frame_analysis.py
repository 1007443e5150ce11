"""The order in which frames are analysed: from the row that is looked at."""

import time

import numpy as np

from datamodules.recording import Recording, read_recordings
from tests.recordings import Written
from zoo.checkpoints.command import Command, Policy, as_policy
from zoo.edit.frame_analysis import CHUNK, FrameAnalysis


class Counting(Policy):
    """A policy with a memory: it steers by the number of frames since its last reset."""

    def __init__(self) -> None:
        self.frames = 0

    def __call__(self, frame: np.ndarray, speed_mph: float) -> Command:
        self.frames += 1
        return Command(self.frames / 1000)

    def reset(self) -> None:
        self.frames = 0


def analysed(recording: Recording, row: int, policy=None) -> FrameAnalysis:
    analysis = FrameAnalysis(recording, policy or as_policy(lambda *_: (0.5, None)))
    analysis.look_at(row)
    analysis.start()
    ends = time.monotonic() + 60
    while analysis.done < len(recording):
        assert time.monotonic() < ends
        time.sleep(0.02)
    analysis.stop()
    return analysis


def test_the_shown_row_is_first_and_every_row_is_analysed(recorded: Written) -> None:
    recording = read_recordings(str(recorded.folder))
    rows, predicted = analysed(recording, 100).predicted_after(0)
    assert CHUNK < 100 < 2 * CHUNK
    assert rows[0] == CHUNK
    assert sorted(rows) == list(range(len(recording)))
    assert (predicted == 0.5).all()


def test_the_differences_of_frames_do_not_depend_on_the_order(recorded: Written) -> None:
    recording = read_recordings(str(recorded.folder))
    first, later = (analysed(recording, row)._differences for row in (0, 100))
    np.testing.assert_array_equal(first, later)


def test_a_policy_with_memory_sees_the_frames_before(recorded: Written) -> None:
    recording = read_recordings(str(recorded.folder))
    predicted = analysed(recording, 100, Counting()).predicted
    np.testing.assert_allclose(predicted[CHUNK:], np.arange(CHUNK, len(recording)) / 1000 + 0.001)

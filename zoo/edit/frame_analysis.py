"""Background analysis of frames: how they differ, and what a network steers."""

import threading
from contextlib import suppress

import numpy as np

from datamodules.image import read_image
from datamodules.notable_rows import (
    NotableRow,
    frame_difference,
    largest_errors,
    odd_frames,
    sharpest_bends,
    standstills,
    steering_jumps,
    thumbnail,
)
from datamodules.recording import Recording
from datamodules.stretches import find_breaks
from zoo.checkpoints.command import Policy


class FrameAnalysis:
    """Analysis of all rows, in order, in a background thread.

    Args:
        recording: recording to analyse.
        policy: policy whose steering is predicted; None for none.

    Attributes:
        predicted: steering of the policy, float32 [N]; NaN where unknown.
        done: number of analysed rows.
    """

    def __init__(self, recording: Recording, policy: Policy | None = None) -> None:
        self.recording, self.policy = recording, policy
        for member in policy.members if policy else ():
            member.rig = recording.rig
        self.predicted = np.full(len(recording), np.nan, np.float32)
        self._differences = np.full(len(recording), np.nan)
        self._last: np.ndarray | None = None
        self._resets = np.concatenate([[True], find_breaks(recording)])
        self.done = 0
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._analyse, daemon=True)

    def predicted_after(self, known: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the rows that were analysed after the first `known`, int, and their steering."""
        rows = np.arange(known, self.done)
        return rows, self.predicted[rows]

    def start(self) -> None:
        """Begin the analysis."""
        self._thread.start()

    def stop(self) -> None:
        """End the analysis, and wait until its thread has ended."""
        self._ending.set()
        if self._thread.is_alive():
            self._thread.join()

    def notable(self) -> dict[str, list[NotableRow]]:
        """Return the notable rows by kind; those of frames and errors among the analysed rows."""
        found = {
            "bends": sharpest_bends(self.recording),
            "jumps": steering_jumps(self.recording),
            "frames": odd_frames(self.recording, self._differences),
            "standstills": standstills(self.recording),
        }
        if self.policy is not None:
            found["errors"] = largest_errors(self.recording, self.predicted)
        return found

    def _analyse(self) -> None:
        if self.policy is not None:
            import torch

            torch.set_num_threads(1)  # of this thread; the page's requests need the other cores
        for row in range(len(self.recording)):
            if self._ending.is_set():
                return
            self._analyse_row(row)
            self.done = row + 1

    def _analyse_row(self, row: int) -> None:
        path = self.recording.images[row, 0]
        last, self._last = self._last, None
        try:
            self._last = thumbnail(path)
            if last is not None:
                self._differences[row] = frame_difference(last, self._last)
        except (OSError, ValueError):
            self._differences[row] = np.inf
        if self.policy is None:
            return
        if self._resets[row]:
            self.policy.reset()
        with suppress(Exception):  # of a bad image or a network; the row stays unknown
            command = self.policy(read_image(path), float(self.recording.speed_mph[row]))
            self.predicted[row] = command.steering

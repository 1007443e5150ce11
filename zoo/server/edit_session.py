"""State of an editing session: the edits with undo, their writing, and the analysis of frames."""

import secrets
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np

from datamodules import recording_edits
from datamodules.edited_recording import WrittenRecording, write_edited
from datamodules.image import read_image
from datamodules.looking import notable_rows
from datamodules.recording import Recording
from datamodules.recording_edits import Edits
from datamodules.stretches import find_breaks
from zoo.base.errors import InputError
from zoo.base.new_folder import free_folder
from zoo.checkpoints.policy_base import Policy

MOST_UNDO = 1000  # steps


class EditSession:
    """An editing session of one recording; safe to use from several threads.

    Args:
        recording: recording to edit.
        edits: edits to begin with.
        out: new folder to write; None for the recording's with `_edited`. If it exists, as after
            the first writing, a number is added.
        report: function called with each written recording.

    Attributes:
        name: random name of the session.
        changes: number of changes of the edits so far.
        lock: lock of the edits, for a check of `changes` before a change.
        out: folder to write first.
        written: recording that was written last; None before.
    """

    def __init__(
        self,
        recording: Recording,
        edits: Edits,
        out: Path | None = None,
        report: Callable[[WrittenRecording], None] = lambda written: None,
    ) -> None:
        self.recording, self._report = recording, report
        self.name, self.changes, self.lock = secrets.token_hex(4), 0, threading.RLock()
        first = Path(recording.names[0]).absolute()
        self.out = (out or first.with_name(f"{first.name}_edited")).expanduser().absolute()
        self.written: WrittenRecording | None = None
        self._now = edits
        self._past: list[Edits] = []  # before, the latest last
        self._future: list[Edits] = []  # after undo, the next last
        self._saved = Edits(len(recording))
        self._share: float | None = None  # of the writing
        self._failure, self._finished = "", 0  # of the last writing; number of writings
        self._thread: threading.Thread | None = None

    @property
    def unsaved(self) -> bool:
        """Whether there are edits that were not written."""
        return self._now != self._saved

    def options(self) -> list[str]:
        """Return the command's options for the edits of now."""
        return recording_edits.edit_options(self._now)

    def change(self, name: str, value: object) -> None:
        """Apply an edit: `drop`, `restore`, `trim`, `mirror`, `merge`, `split`, `undo` or `redo`.

        Args:
            name: name of the edit.
            value: first row and the row after the last one; a row for `split`, True for the others.

        Raises:
            UsageError: the rows are not of the recording.
        """
        with self.lock:
            stacks = {"undo": (self._past, self._future), "redo": (self._future, self._past)}
            if name not in stacks:
                edits = getattr(recording_edits, name)(self._now, value)
                if edits != self._now:
                    self._past = [*self._past, self._now][-MOST_UNDO:]
                    self._now, self._future, self.changes = edits, [], self.changes + 1
                return
            source, target = stacks[name]
            if source:
                target.append(self._now)
                self._now, self.changes = source.pop(), self.changes + 1

    def write(
        self,
        progress: Callable[[float], None] = lambda share: None,
        edits: Edits | None = None,
    ) -> None:
        """Write the edited recording.

        Args:
            progress: function called with the finished share, 0..1.
            edits: edits to write; None for those of now.

        Raises:
            InputError: see `write_edited`.
        """
        edits = edits or self._now
        self.written = write_edited(self.recording, edits, free_folder(self.out), progress)
        self._saved = edits
        self._report(self.written)

    def start_writing(self) -> bool:
        """Write in the background; return False if a writing still runs."""
        with self.lock:
            if self._share is not None:
                return False
            self._share, self._failure = 0.0, ""
            self._thread = threading.Thread(
                target=self._write_in_background, args=(self._now,), daemon=True
            )
            self._thread.start()
            return True

    def finish(self) -> None:
        """Wait until nothing is being written."""
        if self._thread is not None:
            self._thread.join()

    def _write_in_background(self, edits: Edits) -> None:
        def note(share: float) -> None:
            self._share = share

        try:
            self.write(note, edits)
        except InputError as error:
            self._failure = str(error)
        except Exception as error:
            self._failure = f"{type(error).__name__}: {error}"
        finally:
            self._share, self._finished = None, self._finished + 1

    def state(self) -> dict:
        """Return the edits and the writing as plain containers."""
        edits, written = self._now, self.written
        return {
            "session": self.name,
            "changes": self.changes,
            "dropped": edits.dropped,
            "mirrored": edits.mirrored,
            "splits": edits.splits,
            "parts": [len(rows) for rows, _ in edits.parts()],
            "undo": len(self._past),
            "redo": len(self._future),
            "unsaved": self.unsaved,
            "out": str(free_folder(self.out)),
            "writing": self._share,
            "finished": self._finished,
            "failure": self._failure,
            "written": written
            and {
                "folders": [str(folder) for folder in written.folders],
                "rows": written.rows,
                "left_out": written.left_out[:5],
                "left_out_count": len(written.left_out),
            },
        }


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
        self.recording, self.policy = recording, policy and policy.in_car(recording.rig)
        self.predicted = np.full(len(recording), np.nan, np.float32)
        self._differences = np.full(len(recording), np.nan)
        self._last: np.ndarray | None = None
        self._resets = np.concatenate([[True], find_breaks(recording)])
        self.done = 0
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._analyse, daemon=True)

    def predicted_after(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the rows that were analysed after the first `count`, int, and their steering."""
        rows = np.arange(count, self.done)
        return rows, self.predicted[rows]

    def start(self) -> None:
        """Begin the analysis."""
        self._thread.start()

    def stop(self) -> None:
        """End the analysis, and wait until its thread has ended."""
        self._ending.set()
        if self._thread.is_alive():
            self._thread.join()

    def notable(self) -> dict[str, list[notable_rows.NotableRow]]:
        """Return the notable rows by kind; those of frames and errors among the analysed rows."""
        rows = {
            "bends": notable_rows.sharpest_bends(self.recording),
            "jumps": notable_rows.steering_jumps(self.recording),
            "frames": notable_rows.odd_frames(self.recording, self._differences),
            "standstills": notable_rows.standstills(self.recording),
        }
        if self.policy is not None:
            rows["errors"] = notable_rows.largest_errors(self.recording, self.predicted)
        return rows

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
            self._last = notable_rows.thumbnail(path)
            if last is not None:
                self._differences[row] = notable_rows.frame_difference(last, self._last)
        except (OSError, ValueError, InputError):  # InputError of a damaged video
            self._differences[row] = np.inf
        if self.policy is None:
            return
        if self._resets[row]:
            self.policy.reset()
        with suppress(Exception):  # of a bad image or a network; the row stays unknown
            command = self.policy(read_image(path), float(self.recording.speed_mph[row]))
            self.predicted[row] = command.steering

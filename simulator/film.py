"""A writer of films that browsers play: H.264 in an .mp4, frame by frame."""

import contextlib
import signal
import subprocess
import threading
from collections import deque
from pathlib import Path
from types import TracebackType

import imageio_ffmpeg
import numpy as np

from zoo.base.errors import InputError
from zoo.base.whole_file import whole_path
from zoo.base.written_files import check_output, note_output

DISK_FULL = "No space left on device"
LINES = 20  # last lines of ffmpeg's output, searched for the reason of a failure


class Film:
    """A film that is being written; a context manager.

    The file appears under its name when the film is complete. An existing file is replaced only if
    drivezoo wrote it.

    Args:
        path: path of the .mp4.
        fps: frames per second.

    Raises:
        InputError: the path cannot be written to, the disk is full, or see `check_output`.
    """

    def __init__(self, path: Path | str, fps: float) -> None:
        self.path, self.fps = Path(path), fps
        if self.path.suffix != ".mp4":
            raise InputError(f"{self.path}: the name of a film must end in .mp4")
        if fps <= 0:
            raise InputError(f"fps={fps:g}: must be above 0")
        self._whole = whole_path(self.path)
        self._ffmpeg: subprocess.Popen | None = None
        self._lines: deque[str] = deque(maxlen=LINES)
        self._size = (0, 0)
        check_output(self.path)
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise self._unwritable(error) from None

    def __enter__(self) -> "Film":
        return self

    def add(self, frame: np.ndarray) -> None:
        """Append a frame, uint8 [H, W, 3], RGB.

        H.264 in yuv420p needs an even height and width: an odd last row or column is cut off.

        Raises:
            InputError: the frame's size differs from the first one's, or the disk is full.
        """
        frame = frame[: frame.shape[0] // 2 * 2, : frame.shape[1] // 2 * 2]
        height, width = frame.shape[:2]
        if self._ffmpeg is None:
            self._size = width, height
            self._start(width, height)
        if self._size != (width, height):  # ffmpeg reads bytes without a shape
            raise InputError(
                f"{self.path}: a frame is {width} x {height}, the film is "
                f"{self._size[0]} x {self._size[1]}"
            )
        try:
            self._ffmpeg.stdin.write(np.ascontiguousarray(frame))
        except BrokenPipeError:
            self._ffmpeg.wait()
            raise self._failed() from None

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._ffmpeg is None:
            return
        if kind is not None:
            self._ffmpeg.kill()
        with contextlib.suppress(BrokenPipeError):  # ffmpeg has ended; its status is read below
            self._ffmpeg.stdin.close()
        complete = self._ffmpeg.wait() == 0 and kind is None
        try:
            if complete:
                self._whole.__exit__(None, None, None)
                note_output(self.path)
            else:  # removes the hidden file
                self._whole.__exit__(RuntimeError, RuntimeError(), None)
        except OSError as failure:
            self._lines.append(failure.strerror)
            complete = False
        if kind is None and not complete:
            raise self._failed()
        self._reader.join()

    def _start(self, width: int, height: int) -> None:
        try:
            unfinished = self._whole.__enter__().absolute()
        except OSError as error:
            raise self._unwritable(error) from None
        command = [imageio_ffmpeg.get_ffmpeg_exe(), "-y", "-v", "error"]
        command += ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}"]
        command += ["-r", f"{self.fps:.6g}", "-i", "-", "-an"]
        command += ["-c:v", "libx264", "-preset", "veryfast", "-crf", "27"]
        command += ["-pix_fmt", "yuv420p"]  # the format that every browser plays
        # The index comes first, so that a browser plays before it has the whole file.
        command += ["-movflags", "+faststart", "-f", "mp4", str(unfinished)]
        # In its own session, because Ctrl-C must end the drive only; the film is then completed.
        self._ffmpeg = subprocess.Popen(
            command, stdin=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True
        )
        self._reader = threading.Thread(target=self._read_lines, daemon=True)
        self._reader.start()

    def _read_lines(self) -> None:
        with self._ffmpeg.stderr as stderr:
            self._lines.extend(line.decode(errors="replace").strip() for line in stderr)

    def _unwritable(self, error: OSError) -> InputError:
        return InputError(f"{self.path}: cannot be written: {error.strerror}")

    def _failed(self) -> InputError:
        """Return the error that names the film, the reason and the remedy."""
        self._reader.join()
        status = self._ffmpeg.returncode
        reason = f"ffmpeg ended with exit status {status}"
        if status < 0:
            reason = f"ffmpeg was ended by a signal: {signal.strsignal(-status)}"
        elif self._lines:
            reason = self._lines[-1].rpartition("] ")[2]
        if any(DISK_FULL in line for line in self._lines):
            reason = f"the disk is full ({DISK_FULL}); free some space there"
        return InputError(f"{self.path}: the film cannot be written: {reason}")

"""Writers of videos and films that browsers play: H.264, by the ffmpeg of imageio-ffmpeg.

`imageio_ffmpeg.write_frames` does not look at ffmpeg's exit status and passes its messages on to
the terminal, so that a video that a full disk cut off would count as complete.
"""

import contextlib
import signal
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from zoo.base.child_process import NEW_GROUP
from zoo.base.errors import InputError, file_errors
from zoo.base.whole_file import whole_path

FILMS = (".mp4",)  # endings of a film's name
UNWRITTEN = "cannot be written: {}"
DISK_FULL = "No space left on device"
# Encoding of a film: veryfast takes twice as long, and its files are as large.
FILM = ("-preset", "superfast", "-crf", "27")


class VideoWriter(contextlib.AbstractContextManager):
    """A video of a constant rate that is being written.

    Args:
        path: path of the .mp4; an existing file is replaced.
        name: name of the video in errors.
        size: width and height, even.
        fps: frames per second.
        options: ffmpeg's options of scaling and encoding.
    """

    def __init__(
        self, path: Path, name: object, size: tuple[int, int], fps: float, options: Sequence[str]
    ) -> None:
        import imageio_ffmpeg  # 30 MB, needed only for videos

        self.name, self.size = name, size
        command = [imageio_ffmpeg.get_ffmpeg_exe(), "-y", "-v", "error", "-f", "rawvideo"]
        command += ["-pix_fmt", "rgb24", "-s", "{}x{}".format(*size), "-r", f"{fps:.6g}"]
        # yuv420p is the format that every browser plays.
        command += ["-i", "-", "-an", *options, "-c:v", "libx264", "-pix_fmt", "yuv420p"]
        # The index comes first, so that a browser plays before it has the whole file.
        command += ["-movflags", "+faststart", "-f", "mp4", f"file:{path.absolute()}"]
        self._messages = tempfile.TemporaryFile()  # noqa: SIM115 - closed by __exit__
        # In its own session, on Windows in its own group of processes, because Ctrl-C must end the
        # drive only; the video is then completed.
        self._ffmpeg = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=self._messages,
            start_new_session=True,
            creationflags=NEW_GROUP,
        )
        self._pipe: Any = self._ffmpeg.stdin

    def add(self, frame: np.ndarray) -> None:
        """Append a frame, uint8 [H, W, 3] RGB.

        Raises:
            InputError: the frame has another size, or ffmpeg has ended, as after a full disk.
        """
        size = frame.shape[1], frame.shape[0]
        if size != self.size:  # ffmpeg reads bytes without a shape
            frames = "a frame is {} x {}, the film is {} x {}".format(*size, *self.size)
            raise InputError(f"{self.name}: {frames}")
        try:
            self._pipe.write(np.ascontiguousarray(frame).data)
        except OSError:  # a broken pipe, which is EINVAL on Windows
            self._ffmpeg.wait()
            raise self._failed() from None

    def __exit__(self, *error: Any) -> None:
        is_complete = error[0] is None
        if not is_complete:
            self._ffmpeg.kill()
        with contextlib.suppress(OSError):  # ffmpeg has ended; its status is read below
            self._pipe.close()
        with self._messages:
            if self._ffmpeg.wait() and is_complete:
                raise self._failed()

    def _failed(self) -> InputError:
        """Return the error that names the video, the reason and the remedy."""
        self._messages.seek(0)
        lines = self._messages.read().decode(errors="replace").split("\n")
        status = self._ffmpeg.returncode
        reason = next(filter(None, reversed(lines)), f"ffmpeg ended with exit status {status}")
        if status < 0:
            reason = f"ffmpeg was ended by a signal: {signal.strsignal(-status)}"
        if any(DISK_FULL in line for line in lines):
            reason = f"the disk is full ({DISK_FULL}); free some space there"
        return InputError(f"{self.name}: the video cannot be written: {reason.rpartition('] ')[2]}")


class Film(contextlib.AbstractContextManager):
    """A film that is being written; a context manager.

    The file appears under its name when the film is complete, and replaces an earlier one.

    Args:
        path: path of the .mp4.
        fps: frames per second, above 0.

    Raises:
        InputError: the path cannot be written to, or the disk is full.
    """

    def __init__(self, path: Path | str, fps: float) -> None:
        self.path, self.fps = Path(path).expanduser(), fps
        self._open = contextlib.ExitStack()
        self._video: VideoWriter | None = None
        with file_errors(self.path, UNWRITTEN):
            self.path.parent.mkdir(parents=True, exist_ok=True)

    def add(self, frame: np.ndarray) -> None:
        """Append a frame, uint8 [H, W, 3], RGB.

        H.264 in yuv420p needs an even height and width: an odd last row or column is cut off.

        Raises:
            InputError: the frame's size differs from the first one's, or the disk is full.
        """
        frame = frame[: frame.shape[0] // 2 * 2, : frame.shape[1] // 2 * 2]
        if self._video is None:
            with file_errors(self.path, UNWRITTEN):
                part = self._open.enter_context(whole_path(self.path))
            video = VideoWriter(part, self.path, frame.shape[1::-1], self.fps, FILM)
            self._video = self._open.enter_context(video)
        self._video.add(frame)

    def __exit__(self, *error: Any) -> None:
        with file_errors(self.path, UNWRITTEN):
            self._open.__exit__(*error)

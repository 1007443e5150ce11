"""Write and read videos frame by frame with the ffmpeg of imageio-ffmpeg."""

import contextlib
import os
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType

import imageio_ffmpeg
import numpy as np

from datamodules.image import MOST_PIXELS
from zoo.base.errors import InputError
from zoo.base.regular_file import open_regular

MOST_VIDEO_BYTES = 64_000_000_000
# As LeRobot's own writer: every second frame is a key frame, so that any frame is read quickly.
KEY_FRAMES = 2
# Without these, the conversion between RGB and YUV rounds down: frames get darker by 1 of 255.
EXACT_COLOURS = ["-sws_flags", "bicubic+accurate_rnd+full_chroma_int+full_chroma_inp"]


class VideoWriter:
    """An H.264 video of a constant rate that is being written; a context manager.

    Args:
        path: path of the new .mp4.
        size: width and height, even.
        fps: frames per second.
        crf: x264's quality, 1 (best) to 51.
    """

    def __init__(self, path: Path, size: tuple[int, int], fps: int, crf: int) -> None:
        self.path, self.frames = path, 0
        command = [imageio_ffmpeg.get_ffmpeg_exe(), "-n", "-v", "error", "-f", "rawvideo"]
        command += ["-pix_fmt", "rgb24", "-s", "{}x{}".format(*size), "-r", str(fps), "-i", "-"]
        command += [*EXACT_COLOURS, "-an", "-c:v", "libx264", "-preset", "fast", "-crf", str(crf)]
        # Without B-frames the first frame's time is 0.
        command += ["-g", str(KEY_FRAMES), "-bf", "0", "-pix_fmt", "yuv420p"]
        command += ["-movflags", "+faststart", f"file:{path.absolute()}"]
        self._messages = tempfile.TemporaryFile()  # noqa: SIM115 - closed by __exit__
        self._ffmpeg = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=self._messages
        )
        assert self._ffmpeg.stdin is not None
        self._pipe = self._ffmpeg.stdin

    def __enter__(self) -> "VideoWriter":
        return self

    def add(self, frame: np.ndarray) -> None:
        """Append a frame, uint8 [H, W, 3] RGB.

        Raises:
            InputError: ffmpeg has ended, as after a full disk.
        """
        try:
            self._pipe.write(np.ascontiguousarray(frame).data)
        except BrokenPipeError:
            self._ffmpeg.wait()
            raise self._failed() from None
        self.frames += 1

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is not None:
            self._ffmpeg.kill()
        with contextlib.suppress(BrokenPipeError):  # ffmpeg has ended; its status is read below
            self._pipe.close()
        with self._messages:
            if self._ffmpeg.wait() and kind is None:
                raise self._failed()

    def _failed(self) -> InputError:
        self._messages.seek(0)
        lines = self._messages.read().decode(errors="replace").split("\n")
        reason = next(filter(None, reversed(lines)), f"exit status {self._ffmpeg.returncode}")
        return InputError(
            f"{self.path.name}: the video cannot be written: {reason}; nothing was written: free "
            "some space, or name another folder with out="
        )


def read_frames(path: Path) -> Iterator[np.ndarray]:
    """Yield a video's frames in order, uint8 [H, W, 3] RGB.

    Only the file itself is opened: ffmpeg takes it for nothing but MP4, follows no playlist in it
    and opens no address.

    Raises:
        InputError: the file is missing or damaged, or its frames are too large.
    """
    try:
        descriptor, _ = open_regular(path, MOST_VIDEO_BYTES)
        os.close(descriptor)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}; download the file again") from None
    limits = ["-f", "mov", "-protocol_whitelist", "file", "-max_pixels", str(MOST_PIXELS)]
    reader = imageio_ffmpeg.read_frames(
        f"file:{path.absolute()}",
        input_params=[*limits, "-err_detect", "explode", "-xerror"],
        output_params=["-map", "0:v:0", "-fps_mode", "passthrough", *EXACT_COLOURS],
    )
    with contextlib.closing(reader):
        try:
            width, height = next(reader)["size"]
        except Exception:  # a damaged header can make its parser raise anything
            raise InputError(f"{path}: no MP4 video, or damaged; download it again") from None
        if width * height > MOST_PIXELS:
            raise InputError(
                f"{path}: frames of {width} x {height} pixels, more than {MOST_PIXELS:,}; scale "
                "the video down"
            )
        while True:
            try:
                data = next(reader, None)
            except RuntimeError:
                raise InputError(f"{path}: the video is damaged; download it again") from None
            if data is None:
                return
            yield np.frombuffer(data, np.uint8).reshape(height, width, 3)

"""Films that play in a browser: H.264 in an .mp4, written frame by frame."""

from collections.abc import Generator
from pathlib import Path
from types import TracebackType

import imageio_ffmpeg
import numpy as np

from simulator.errors import SimulatorError


class Film:
    """A film being written; use it in a `with`. It takes its name when it is whole.

    Args:
        path: of the .mp4; replaced if it is there.
        fps: frames per second.

    Raises:
        SimulatorError: the path cannot be written to, or the disk is full.
    """

    def __init__(self, path: Path | str, fps: float) -> None:
        self.path, self.fps = Path(path), fps
        if self.path.suffix != ".mp4":
            raise SimulatorError(f"{self.path}: a film's name must end in .mp4")
        if fps <= 0:
            raise SimulatorError(f"fps={fps:g}: must be above 0")
        self._unfinished = self.path.with_name(f".{self.path.name}.part.mp4")
        self._writer: Generator | None = None
        self._size = (0, 0)
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise SimulatorError(f"{self.path}: cannot be written: {error.strerror}") from None

    def __enter__(self) -> "Film":
        return self

    def add(self, frame: np.ndarray) -> None:
        """Append uint8 [H, W, 3] RGB; an odd row or column at the edge, which H.264 in yuv420p
        cannot hold, is cut off.

        Raises:
            SimulatorError: it has not the first one's size, or the disk is full.
        """
        frame = frame[: frame.shape[0] // 2 * 2, : frame.shape[1] // 2 * 2]
        height, width = frame.shape[:2]
        if self._writer is None:
            self._size = width, height
            self._writer = imageio_ffmpeg.write_frames(
                str(self._unfinished),
                (width, height),
                fps=self.fps,
                codec="libx264",
                pix_fmt_out="yuv420p",  # what every browser plays
                macro_block_size=2,
                ffmpeg_log_level="error",
                # The index comes first, so that a browser need not have it all to begin.
                output_params=["-preset", "veryfast", "-crf", "27", "-movflags", "+faststart"],
            )
            self._writer.send(None)
        if self._size != (width, height):  # bytes have no shape: ffmpeg would garble the rest
            raise SimulatorError(
                f"{self.path}: a frame is {width} x {height}, the film is "
                f"{self._size[0]} x {self._size[1]}"
            )
        try:
            self._writer.send(np.ascontiguousarray(frame))
        except OSError as error:
            reason = str(error).strip().splitlines()[0]
            raise SimulatorError(f"{self.path}: the film cannot be written: {reason}") from None

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._writer is None:
            return
        self._writer.close()
        if kind is not None:
            self._unfinished.unlink(missing_ok=True)
        elif self._unfinished.exists():
            self._unfinished.replace(self.path)

"""A writer of films that browsers play: H.264 in an .mp4, frame by frame."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from zoo.base.errors import InputError
from zoo.base.video import VideoWriter
from zoo.base.whole_file import whole_path
from zoo.base.written_files import check_output, note_output

ENCODING = ("-preset", "veryfast", "-crf", "27")


class Film(contextlib.AbstractContextManager):
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
        self._open = contextlib.ExitStack()
        self._video: VideoWriter | None = None
        check_output(self.path)
        with self._reported():
            self.path.parent.mkdir(parents=True, exist_ok=True)

    def add(self, frame: np.ndarray) -> None:
        """Append a frame, uint8 [H, W, 3], RGB.

        H.264 in yuv420p needs an even height and width: an odd last row or column is cut off.

        Raises:
            InputError: the frame's size differs from the first one's, or the disk is full.
        """
        frame = frame[: frame.shape[0] // 2 * 2, : frame.shape[1] // 2 * 2]
        if self._video is None:
            with self._reported():
                part = self._open.enter_context(whole_path(self.path))
            size = frame.shape[1], frame.shape[0]
            video = VideoWriter(part, self.path, size, self.fps, ENCODING)
            self._video = self._open.enter_context(video)
        self._video.add(frame)

    def __exit__(self, kind: type[BaseException] | None, *error: object) -> None:
        with self._reported():
            self._open.__exit__(kind, *error)
        if kind is None and self._video is not None:
            note_output(self.path)

    @contextlib.contextmanager
    def _reported(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise InputError(f"{self.path}: cannot be written: {error.strerror}") from None

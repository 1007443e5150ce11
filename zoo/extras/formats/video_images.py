"""Images of rows whose frames are counted in a video."""

from collections.abc import Callable
from pathlib import Path

from datamodules.image import StoredImage
from datamodules.recording import ForwardReader
from zoo.extras.formats.video_frames import read_frames


def video_images(video: Path) -> Callable[[int], StoredImage]:
    """Return a function from a frame's number, from 0, to the image in a video."""
    reader = ForwardReader(lambda file: read_frames(Path(file)))
    return lambda number: StoredImage(str(video), number, reader)

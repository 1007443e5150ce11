"""Write and read videos frame by frame with the ffmpeg of imageio-ffmpeg."""

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path

import imageio_ffmpeg
import numpy as np

from datamodules.image import MOST_PIXELS, ForwardReader, StoredImage
from zoo.base.bounded_files import open_data
from zoo.base.errors import InputError, library_errors
from zoo.base.video import VideoWriter

MOST_VIDEO_BYTES = 64_000_000_000
CONTAINERS = {".mp4": "mov", ".mov": "mov", ".avi": "avi", ".hevc": "hevc"}  # ffmpeg's names
KINDS = {"mov": "MP4", "avi": "AVI", "hevc": "HEVC"}
# As LeRobot's own writer: every second frame is a key frame, so that any frame is read quickly.
KEY_FRAMES = 2
# Without these, the conversion between RGB and YUV rounds down: frames get darker by 1 of 255.
EXACT_COLOURS = ["-sws_flags", "bicubic+accurate_rnd+full_chroma_int+full_chroma_inp"]


def video_writer(path: Path, size: tuple[int, int], fps: int, crf: int) -> VideoWriter:
    """Return a writer of a new video.

    Args:
        path: path of the new .mp4.
        size: width and height, even.
        fps: frames per second.
        crf: x264's quality, 1 (best) to 51.
    """
    # Without B-frames the first frame's time is 0.
    encoding = ["-preset", "fast", "-crf", str(crf), "-g", str(KEY_FRAMES), "-bf", "0"]
    return VideoWriter(path, path.name, size, fps, [*EXACT_COLOURS, *encoding])


def read_frames(path: Path) -> Iterator[np.ndarray]:
    """Yield a video's frames in order, uint8 [H, W, 3] RGB.

    Only the file itself is opened: ffmpeg takes it for nothing but the container of its suffix
    (MP4 without one), follows no playlist in it and opens no address.

    Raises:
        InputError: the file is missing or damaged, or its frames are too large.
    """
    container = CONTAINERS.get(path.suffix.lower(), "mov")
    fault = f"no {KINDS[container]} video, or damaged"
    with library_errors(path, fault, "copy it again"):
        open_data(path, MOST_VIDEO_BYTES).close()
    limits = ["-f", container, "-protocol_whitelist", "file", "-max_pixels", str(MOST_PIXELS)]
    reader = imageio_ffmpeg.read_frames(
        f"file:{path.absolute()}",
        input_params=[*limits, "-err_detect", "explode", "-xerror"],
        output_params=["-map", "0:v:0", "-fps_mode", "passthrough", *EXACT_COLOURS],
    )
    with contextlib.closing(reader), library_errors(path, fault, "copy it again"):
        width, height = next(reader)["size"]
        if width * height > MOST_PIXELS:
            raise InputError(
                f"{path}: frames of {width} x {height} pixels, more than {MOST_PIXELS:,}; scale "
                "the video down"
            )
        for data in reader:
            yield np.frombuffer(data, np.uint8).reshape(height, width, 3)


def video_images(video: Path) -> Callable[[int], StoredImage]:
    """Return a function from a frame's number, from 0, to the image in a video."""
    reader = ForwardReader(read_frames)
    return lambda number: StoredImage(str(video), number, reader)

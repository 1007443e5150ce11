"""Write the videos of a LeRobotDataset v3, with as many whole episodes in a file as it holds."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from datamodules.driving_log import CAMERAS
from datamodules.formats.lerobot_layout import CAMERA_PREFIX, video_file
from datamodules.formats.lerobot_stats import SAMPLED_FRAMES, FrameCounts
from datamodules.formats.video import video_writer
from datamodules.image import FRAME_HEIGHT, FRAME_WIDTH, read_image
from datamodules.recording import Recording
from zoo.base.errors import InputError


@dataclass(frozen=True)
class VideoFile:
    """Episodes that share a video file: its number, and each episode's first frame in it."""

    number: int
    first_frames: dict[int, int]


def assign_video_files(episodes: list[range], most: int) -> list[VideoFile]:
    """Return the video files: as many whole episodes in each as `most` frames hold."""
    files = [VideoFile(0, {})]
    frames = 0
    for number, rows in enumerate(episodes):
        if frames and frames + len(rows) > most:
            files.append(VideoFile(len(files), {}))
            frames = 0
        files[-1].first_frames[number] = frames
        frames += len(rows)
    return files


def write_videos(
    folder: Path,
    recording: Recording,
    camera: str,
    episodes: list[range],
    files: list[VideoFile],
    rate: int,
    crf: int,
    progress: Callable[[float], None],
) -> list[FrameCounts]:
    """Write a camera's video files; return the counts of each episode's sampled frames."""
    column = CAMERAS.index(camera)
    counts = []
    for file in files:
        path = folder / video_file(CAMERA_PREFIX + camera, 0, file.number)
        path.parent.mkdir(parents=True, exist_ok=True)
        with video_writer(path, (FRAME_WIDTH, FRAME_HEIGHT), rate, crf) as video:
            for number in file.first_frames:
                counts.append(FrameCounts())
                for frame, row in enumerate(episodes[number]):
                    image = _read(recording, row, column)
                    video.add(image)
                    if frame % SAMPLED_FRAMES == 0:
                        counts[-1].add(image)
                    progress(row / len(recording))
    return counts


def _read(recording: Recording, row: int, column: int) -> np.ndarray:
    path = recording.images[row, column]
    try:
        return read_image(path)
    except ValueError as error:
        raise InputError(
            f"{recording.place(row)}: {path}: {error}; drop the row: drivezoo edit"
        ) from None

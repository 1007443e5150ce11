"""Names of files, columns and features in a LeRobotDataset v3.

Written after `lerobot/datasets/utils.py` and `lerobot_dataset.py` of version 0.4.4.
"""

from typing import Any

from zoo.base.errors import InputError

VERSION = "v3.0"
INFO = "meta/info.json"
STATS = "meta/stats.json"
TASKS = "meta/tasks.parquet"
EPISODES = "meta/episodes"
DATA = "data"
FILE = "chunk-{chunk:03d}/file-{file:03d}"
# What info.json has for the same places.
DATA_PATH = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
VIDEO_PATH = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"

CAMERA_PREFIX = "observation.images."
STATE, ACTION = "observation.state", "action"
ACTIONS = ("steering", "throttle", "brake")
# Two numbers, because LeRobot 0.4.4 reads a feature of one number without its dimension, and its
# policies then fail on a batch.
STATES = ("speed_mph", "speed_mps")
# Columns of drivezoo's own datasets: recorded values in float64, unchanged to the bit. Their names
# start neither with `observation` nor with `action`, so that LeRobot's policies do not take them.
EXACT = ("steering", "throttle", "brake", "speed_mph")
TIME = "time_s"
# Seconds of an episode and of a video file. LeRobot finds a frame by its time as float32, within
# 1e-4 s: after 1,024 s two neighbouring float32 are farther apart.
MOST_S = 600


def video_file(key: str, chunk: int, file: int) -> str:
    """Return the path of a camera's video in the dataset."""
    return f"videos/{key}/{FILE.format(chunk=chunk, file=file)}.mp4"


def load_pyarrow() -> Any:
    """Return pyarrow with its Parquet module.

    Raises:
        InputError: it is not installed.
    """
    try:
        import pyarrow.parquet
    except ImportError:
        raise InputError(
            "LeRobot's datasets are Parquet files, which need pyarrow; "
            "pip install 'drivezoo[parquet]'"
        ) from None
    return pyarrow

"""Write the videos, the Parquet tables and the JSON files of a LeRobotDataset v3."""

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from datamodules.driving_log import CAMERAS
from datamodules.formats.lerobot_features import (
    ACTION,
    ACTIONS,
    CAMERA_PREFIX,
    DATA,
    DATA_PATH,
    EPISODES,
    FILE,
    STATE,
    STATES,
    TASKS,
    VERSION,
    VIDEO_PATH,
    video_file,
)
from datamodules.formats.video import video_writer
from datamodules.image import FRAME_HEIGHT, FRAME_WIDTH, read_image
from datamodules.recording import Recording
from zoo.base.errors import InputError

QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
SAMPLED_FRAMES, SAMPLED_PIXELS = 10, 2  # every tenth frame, every second row and column


def column_stats(values: np.ndarray) -> dict[str, list]:
    """Return a feature's statistics, float [N] or [N, D], as lists of D numbers."""
    table = values.reshape(len(values), -1).astype(float)
    found = {
        "min": table.min(0),
        "max": table.max(0),
        "mean": table.mean(0),
        "std": table.std(0),
        **{name: np.quantile(table, share, axis=0) for name, share in QUANTILES.items()},
    }
    return {name: one.tolist() for name, one in found.items()} | {"count": [len(table)]}


@dataclass
class FrameCounts:
    """Counts of the pixels of a camera's sampled frames: int64 [3, 256], RGB."""

    counts: np.ndarray = field(default_factory=lambda: np.zeros((3, 256), np.int64))
    frames: int = 0

    def add(self, frame: np.ndarray) -> None:
        """Count a frame's pixels, uint8 [H, W, 3]."""
        pixels = frame[::SAMPLED_PIXELS, ::SAMPLED_PIXELS]
        for channel in range(3):
            self.counts[channel] += np.bincount(pixels[..., channel].ravel(), minlength=256)
        self.frames += 1

    def __add__(self, other: "FrameCounts") -> "FrameCounts":
        return FrameCounts(self.counts + other.counts, self.frames + other.frames)

    def stats(self) -> dict[str, list]:
        """Return the statistics of pixels in 0..1, as [3][1][1], as LeRobot shapes them."""
        levels = np.arange(256) / 255
        total = self.counts.sum(1)
        mean = self.counts @ levels / total
        reached = self.counts.cumsum(1)
        found = {
            "min": levels[(self.counts > 0).argmax(1)],
            "max": levels[255 - (self.counts[:, ::-1] > 0).argmax(1)],
            "mean": mean,
            "std": np.sqrt(np.maximum(self.counts @ levels**2 / total - mean**2, 0)),
        }
        for name, share in QUANTILES.items():
            found[name] = levels[(reached >= share * total[:, None]).argmax(1)]
        shaped = {name: one.reshape(3, 1, 1).tolist() for name, one in found.items()}
        return shaped | {"count": [self.frames]}


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


def dataset_features(columns: dict[str, np.ndarray], cameras: list[str], rate: int) -> dict:
    """Return the features of `info.json`: the data's columns and the videos."""
    names = {ACTION: list(ACTIONS), STATE: list(STATES)}
    features: dict[str, dict] = {}
    for name, column in columns.items():
        shape = list(column.shape[1:]) or [1]
        features[name] = {"dtype": str(column.dtype), "shape": shape, "names": names.get(name)}
    video = {
        "video.height": FRAME_HEIGHT,
        "video.width": FRAME_WIDTH,
        "video.codec": "h264",
        "video.pix_fmt": "yuv420p",
        "video.is_depth_map": False,
        "video.fps": rate,
        "video.channels": 3,
        "has_audio": False,
    }
    for camera in cameras:
        features[CAMERA_PREFIX + camera] = {
            "dtype": "video",
            "shape": [FRAME_HEIGHT, FRAME_WIDTH, 3],
            "names": ["height", "width", "channels"],
            "info": video,
        }
    return features


def dataset_info(rows: int, episodes: int, rate: int, features: dict) -> dict:
    """Return the contents of `info.json`."""
    return {
        "codebase_version": VERSION,
        "robot_type": "drivezoo",
        "total_episodes": episodes,
        "total_frames": rows,
        "total_tasks": 1,
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": rate,
        "splits": {"train": f"0:{episodes}"},
        "data_path": DATA_PATH,
        "video_path": VIDEO_PATH,
        "features": features,
    }


def write_data(folder: Path, columns: dict[str, np.ndarray], pyarrow: Any) -> None:
    """Write the columns of all rows as one Parquet file."""

    def array(column: np.ndarray) -> Any:
        values = pyarrow.array(column.ravel())
        if column.ndim == 1:
            return values
        return pyarrow.FixedSizeListArray.from_arrays(values, column.shape[1])

    table = pyarrow.table({name: array(column) for name, column in columns.items()})
    _write_parquet(folder / DATA / f"{FILE.format(chunk=0, file=0)}.parquet", table, pyarrow)


def write_tasks(folder: Path, task: str, pyarrow: Any) -> None:
    """Write the tasks as pandas does: the words are the index, which LeRobot reads."""
    table = pyarrow.table({"task_index": pyarrow.array([0]), "task": pyarrow.array([task])})

    def about(name: str | None, kind: str, numpy_kind: str) -> dict:
        return {
            "name": name,
            "field_name": name,
            "pandas_type": kind,
            "numpy_type": numpy_kind,
            "metadata": None,
        }

    pandas = {
        "index_columns": ["task"],
        "column_indexes": [about(None, "unicode", "object") | {"metadata": {"encoding": "UTF-8"}}],
        "columns": [about("task_index", "int64", "int64"), about("task", "unicode", "object")],
        "creator": {"library": "pyarrow", "version": pyarrow.__version__},
        "pandas_version": "2.0.0",
    }
    table = table.replace_schema_metadata({"pandas": json.dumps(pandas)})
    _write_parquet(folder / TASKS, table, pyarrow)


def write_episodes(
    folder: Path,
    columns: dict[str, np.ndarray],
    counts: dict[str, list[FrameCounts]],
    episodes: list[range],
    files: list[VideoFile],
    rate: int,
    task: str,
    pyarrow: Any,
) -> None:
    """Write each episode's rows, times in the videos, and statistics."""
    file_of = {number: file for file in files for number in file.first_frames}
    rows = []
    for number, one in enumerate(episodes):
        row: dict[str, Any] = {
            "episode_index": number,
            "tasks": [task],
            "length": len(one),
            "data/chunk_index": 0,
            "data/file_index": 0,
            "dataset_from_index": one.start,
            "dataset_to_index": one.stop,
        }
        first = file_of[number].first_frames[number]
        for camera in counts:
            key = f"videos/{CAMERA_PREFIX}{camera}"
            row[f"{key}/chunk_index"] = 0
            row[f"{key}/file_index"] = file_of[number].number
            row[f"{key}/from_timestamp"] = first / rate
            row[f"{key}/to_timestamp"] = (first + len(one)) / rate
        found = dataset_stats(
            columns, slice(one.start, one.stop), counts, range(number, number + 1)
        )
        for feature, stats in found.items():
            row |= {f"stats/{feature}/{name}": value for name, value in stats.items()}
        row |= {"meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0}
        rows.append(row)
    table = pyarrow.Table.from_pylist(rows)
    _write_parquet(folder / EPISODES / f"{FILE.format(chunk=0, file=0)}.parquet", table, pyarrow)


def dataset_stats(
    columns: dict[str, np.ndarray],
    rows: slice,
    counts: dict[str, list[FrameCounts]],
    episodes: range,
) -> dict[str, dict]:
    """Return the statistics of some rows, and of some episodes' frames."""
    stats = {name: column_stats(column[rows]) for name, column in columns.items()}
    for camera, all_counts in counts.items():
        chosen = [all_counts[number] for number in episodes]
        stats[CAMERA_PREFIX + camera] = sum(chosen[1:], chosen[0]).stats()
    return stats


def _write_parquet(path: Path, table: Any, pyarrow: Any) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("xb") as file:
        pyarrow.parquet.write_table(table, file, compression="snappy")


def write_json(path: Path, contents: dict) -> None:
    """Write a JSON file, indented as LeRobot writes it."""
    path.write_text(json.dumps(contents, indent=4) + "\n", encoding="utf-8")

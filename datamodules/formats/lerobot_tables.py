"""Write the Parquet tables and JSON files of a LeRobotDataset v3."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from datamodules.formats.lerobot_layout import (
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
)
from datamodules.formats.lerobot_stats import FrameCounts, column_stats
from datamodules.formats.lerobot_videos import VideoFile
from datamodules.image import FRAME_HEIGHT, FRAME_WIDTH


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

"""Write a recording as a LeRobotDataset v3: Parquet tables and a video for each camera."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from datamodules.driving_log import CAMERAS
from datamodules.errors import InputError
from datamodules.exchange.continuous_drives import continuous_drives, mean_rate
from datamodules.exchange.converted import Converted, left_out_note
from datamodules.exchange.lerobot_layout import (
    ACTION,
    ACTIONS,
    CAMERA_PREFIX,
    DATA,
    DATA_PATH,
    EPISODES,
    EXACT,
    FILE,
    INFO,
    MOST_S,
    STATE,
    STATES,
    STATS,
    TASKS,
    TIME,
    VERSION,
    VIDEO_PATH,
    load_pyarrow,
    video_file,
)
from datamodules.exchange.lerobot_stats import SAMPLED_FRAMES, FrameCounts, column_stats
from datamodules.exchange.video import VideoWriter
from datamodules.image import FRAME_HEIGHT, FRAME_WIDTH, read_image
from datamodules.image_files import find_file_fault
from datamodules.new_folder import new_folder
from datamodules.recording import Recording
from datamodules.samples import MPS_PER_MPH

MOST_FPS = 1000


@dataclass(frozen=True)
class VideoFile:
    """Episodes that share a video file: its number, and each episode's first frame in it."""

    number: int
    first_frames: dict[int, int]


def export_lerobot(
    recording: Recording,
    out: Path,
    fps: int | None = None,
    crf: int = 18,
    task: str = "follow the road",
    progress: Callable[[float], None] = lambda share: None,
) -> Converted:
    """Write a recording's rows as a dataset; each continuous drive is an episode.

    Args:
        recording: recording to write; its images are written as 320 x 160.
        out: new folder.
        fps: constant frames per second of the dataset, 1..1000; None for the recording's mean.
        crf: quality of the H.264 videos, 1 (best) to 51.
        task: the task in words.
        progress: function called with the finished share, 0..1.

    Raises:
        InputError: pyarrow is missing, no image is whole, `out` exists, or the disk is full.
    """
    pyarrow = load_pyarrow()
    rate = fps or min(max(round(mean_rate(recording)), 1), MOST_FPS)
    with new_folder(out) as part:
        kept, left_out = _whole_rows(recording)
        cameras, notes = _cameras(kept)
        episodes = continuous_drives(kept, most=MOST_S * rate)
        files = _video_files(episodes, MOST_S * rate)
        columns = _columns(kept, episodes, rate)
        counts = {
            camera: _write_videos(part, kept, camera, episodes, files, rate, crf, step)
            for camera, step in zip(cameras, _steps(progress, len(cameras)), strict=True)
        }
        features = _features(columns, cameras, rate)
        (part / "meta").mkdir()
        _write_data(part, columns, pyarrow)
        _write_tasks(part, task, pyarrow)
        _write_episodes(part, columns, counts, episodes, files, rate, task, pyarrow)
        _write_json(part / STATS, _stats(columns, slice(None), counts, range(len(episodes))))
        _write_json(part / INFO, _info(len(kept), len(episodes), rate, features))
    real = mean_rate(kept)
    notes = left_out_note(left_out, "an image is damaged") + notes
    if abs(real / rate - 1) > 0.001:
        notes.append(
            f"recorded at {real:.2f} frames/s, the dataset has {rate}: recorded times are in {TIME}"
        )
    return Converted(out, len(kept), len(episodes), tuple(notes))


def _whole_rows(recording: Recording) -> tuple[Recording, list[str]]:
    """Return the rows whose images are whole, and a line on each other one."""
    left_out, mask = [], np.ones(len(recording), bool)
    for row, paths in enumerate(recording.images.tolist()):
        fault = next(filter(None, (find_file_fault(path) for path in paths if path)), None)
        if fault:
            left_out.append(f"{recording.place(row)}: {fault}")
            mask[row] = False
    if not mask.any():
        raise InputError(f"no row has whole images: {left_out[0]}; copy the images again")
    return recording.keep(mask), left_out


def _cameras(recording: Recording) -> tuple[list[str], list[str]]:
    """Return the cameras with an image in each row, and a note on each that lacks some."""
    cameras, notes = [], []
    for column, camera in enumerate(CAMERAS):
        known = sum(path is not None for path in recording.images[:, column])
        if known == len(recording):
            cameras.append(camera)
        elif known:
            notes.append(
                f"{camera} camera left out: {len(recording) - known:,} of {len(recording):,} rows "
                "have no image of it"
            )
    return cameras, notes


def _video_files(episodes: list[range], most: int) -> list[VideoFile]:
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


def _columns(recording: Recording, episodes: list[range], rate: int) -> dict[str, np.ndarray]:
    """Return the columns of the data, one value or vector for each row."""
    lengths = [len(rows) for rows in episodes]
    frame = np.concatenate([np.arange(length) for length in lengths])
    exact = {name: np.asarray(getattr(recording, name), np.float64) for name in EXACT}
    columns: dict[str, np.ndarray] = {
        ACTION: np.stack([exact[name] for name in ACTIONS], 1).astype(np.float32),
        STATE: np.outer(exact["speed_mph"], (1, MPS_PER_MPH)).astype(np.float32),
        **exact,
    }
    if np.isfinite(recording.time_s).all():
        columns[TIME] = recording.time_s.astype(np.float64)
    return columns | {
        "timestamp": (frame / rate).astype(np.float32),
        "frame_index": frame,
        "episode_index": np.repeat(np.arange(len(episodes)), lengths),
        "index": np.arange(len(recording)),
        "task_index": np.zeros(len(recording), np.int64),
    }


def _write_videos(
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
        with VideoWriter(path, (FRAME_WIDTH, FRAME_HEIGHT), rate, crf) as video:
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


def _steps(progress: Callable[[float], None], cameras: int) -> list[Callable[[float], None]]:
    def step(number: int) -> Callable[[float], None]:
        return lambda share: progress((number + share) / cameras)

    return [step(number) for number in range(cameras)]


def _features(columns: dict[str, np.ndarray], cameras: list[str], rate: int) -> dict:
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


def _info(rows: int, episodes: int, rate: int, features: dict) -> dict:
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


def _write_data(folder: Path, columns: dict[str, np.ndarray], pyarrow: Any) -> None:
    def array(column: np.ndarray) -> Any:
        values = pyarrow.array(column.ravel())
        if column.ndim == 1:
            return values
        return pyarrow.FixedSizeListArray.from_arrays(values, column.shape[1])

    table = pyarrow.table({name: array(column) for name, column in columns.items()})
    _write_parquet(folder / DATA / f"{FILE.format(chunk=0, file=0)}.parquet", table, pyarrow)


def _write_tasks(folder: Path, task: str, pyarrow: Any) -> None:
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


def _write_episodes(
    folder: Path,
    columns: dict[str, np.ndarray],
    counts: dict[str, list[FrameCounts]],
    episodes: list[range],
    files: list[VideoFile],
    rate: int,
    task: str,
    pyarrow: Any,
) -> None:
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
        found = _stats(columns, slice(one.start, one.stop), counts, range(number, number + 1))
        for feature, stats in found.items():
            row |= {f"stats/{feature}/{name}": value for name, value in stats.items()}
        row |= {"meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0}
        rows.append(row)
    table = pyarrow.Table.from_pylist(rows)
    _write_parquet(folder / EPISODES / f"{FILE.format(chunk=0, file=0)}.parquet", table, pyarrow)


def _stats(
    columns: dict[str, np.ndarray],
    rows: slice,
    counts: dict[str, list[FrameCounts]],
    episodes: range,
) -> dict[str, dict]:
    stats = {name: column_stats(column[rows]) for name, column in columns.items()}
    for camera, all_counts in counts.items():
        chosen = [all_counts[number] for number in episodes]
        stats[CAMERA_PREFIX + camera] = sum(chosen[1:], chosen[0]).stats()
    return stats


def _write_parquet(path: Path, table: Any, pyarrow: Any) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("xb") as file:
        pyarrow.parquet.write_table(table, file, compression="snappy")


def _write_json(path: Path, contents: dict) -> None:
    path.write_text(json.dumps(contents, indent=4) + "\n", encoding="utf-8")

"""Write a recording as a LeRobotDataset v3: Parquet tables and a video for each episode and camera.

An episode is a continuous drive, of 600 s at most.
"""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from datamodules.driving_log import CAMERAS
from datamodules.format_options import Converted, Progress, WriteOptions
from datamodules.formats.parquet_columns import load_pyarrow
from datamodules.formats.recording_writer import left_out_note, reported, whole_rows
from datamodules.image import read_image
from datamodules.recorded_car import write_car
from datamodules.recording import LABELS, Recording
from datamodules.stretches import continuous_drives, mean_rate
from zoo.base.errors import InputError
from zoo.base.new_folder import whole_folder
from zoo.base.rig import MPS_PER_MPH
from zoo.extras.formats.lerobot_features import (
    CAMERA_PREFIX,
    DATA,
    DATA_PATH,
    EPISODES,
    INFO,
    ROBOT,
    TIME,
    VERSION,
    VIDEO_PATH,
    video_file,
)
from zoo.extras.formats.video_frames import video_writer

STATS = "meta/stats.json"
TASKS = "meta/tasks.parquet"
STATE, ACTION = "observation.state", "action"
ACTIONS = ("steering", "throttle", "brake")
# Two numbers, because LeRobot 0.4.4 reads a feature of one number without its dimension, and its
# policies then fail on a batch.
STATES = ("speed_mph", "speed_mps")
# Seconds of an episode and of a video file. LeRobot finds a frame by its time as float32, within
# 1e-4 s: after 1,024 s two neighbouring float32 are farther apart.
MOST_S = 600
MOST_FPS = 1000
CHUNK = 1000  # files in a folder
FIRST_FILE = "chunk-000/file-000.parquet"
QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
MOST_STRETCH = 0.05  # of a video's images, beyond the rounding to even numbers
SAMPLED_FRAMES, SAMPLED_PIXELS = 10, 2  # every tenth frame, every second row and column


def write(recording: Recording, out: Path, options: WriteOptions, progress: Progress) -> Converted:
    """Write a recording's rows as a dataset; each continuous drive is an episode.

    The images are written in the size of the first.

    Raises:
        InputError: pyarrow is missing, no image is whole, `out` exists, or the disk is full.
    """
    pyarrow = load_pyarrow()
    with whole_folder(out) as part:
        kept, left_out = whole_rows(recording)
        rate = options.fps or min(max(round(mean_rate(kept)), 1), MOST_FPS)
        images = {camera: list(kept.images[:, at]) for at, camera in enumerate(CAMERAS)}
        cameras = [camera for camera, paths in images.items() if None not in paths]
        height, width = kept.frame_size() or (0, 0)
        size = width // 2 * 2, height // 2 * 2  # H.264 in yuv420p needs even numbers
        episodes = continuous_drives(kept, most=MOST_S * rate)
        columns = _columns(kept, episodes, rate)
        counts: dict[str, list[np.ndarray]] = {camera: [] for camera in cameras}
        stretched: list[str] = []
        done = reported(range(len(kept) * len(cameras)), progress)
        for number, rows in enumerate(episodes):
            for camera in cameras:
                path = part / video_file(CAMERA_PREFIX + camera, *divmod(number, CHUNK))
                path.parent.mkdir(parents=True, exist_ok=True)
                counts[camera].append(
                    _write_video(path, kept, camera, rows, size, rate, options.crf, stretched, done)
                )
        about = [
            _about_episode(number, rows, columns, counts, rate, options.task)
            for number, rows in enumerate(episodes)
        ]
        tables = {
            f"{DATA}/{FIRST_FILE}": _data_table(columns, pyarrow),
            TASKS: _task_table(options.task, pyarrow),
            f"{EPISODES}/{FIRST_FILE}": pyarrow.Table.from_pylist(about),
        }
        for name, table in tables.items():
            (part / name).parent.mkdir(parents=True, exist_ok=True)
            with (part / name).open("xb") as file:
                pyarrow.parquet.write_table(table, file, compression="snappy")
        stats = _stats(columns, range(len(kept)), counts, range(len(episodes)))
        info = _info(columns, cameras, size, len(episodes), rate)
        for name, contents in ((STATS, stats), (INFO, info)):
            (part / name).write_text(json.dumps(contents, indent=4) + "\n", encoding="utf-8")
        write_car(part, recording)
    notes = left_out_note(left_out, "an image is damaged")
    notes += [
        f"{camera} camera left out: {paths.count(None):,} of {len(kept):,} rows have no image of it"
        for camera, paths in images.items()
        if 0 < paths.count(None) < len(kept)
    ]
    if stretched:
        notes.append(
            f"{len(stretched):,} images of another shape are stretched to {size[0]} x {size[1]} "
            f"(the first: {stretched[0]}); convert recordings of each shape alone"
        )
    if abs((real := mean_rate(kept)) / rate - 1) > 0.001:
        notes.append(
            f"recorded at {real:.2f} frames/s, the dataset has {rate}: recorded times are in {TIME}"
        )
    viewer = ("lerobot-dataset-viz", "--repo-id", f"local/{out.name}", "--root", str(out))
    following, purpose = (*viewer, "--episode-index", "0"), "where LeRobot is installed"
    return Converted(out, len(kept), len(episodes), tuple(notes), following, purpose)


def _columns(recording: Recording, episodes: list[range], rate: int) -> dict[str, np.ndarray]:
    """Return the columns of the data, one value or vector for each row."""
    lengths = [len(rows) for rows in episodes]
    frame = np.concatenate([np.arange(length) for length in lengths])
    # Columns of drivezoo's own datasets: recorded values in float64, unchanged to the bit. Their
    # names start neither with `observation` nor with `action`, so that LeRobot's policies do not
    # take them.
    exact = {name: np.asarray(getattr(recording, name), np.float64) for name in LABELS}
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


def _write_video(
    path: Path,
    recording: Recording,
    camera: str,
    rows: range,
    size: tuple[int, int],
    rate: int,
    crf: int,
    stretched: list[str],
    done: Iterator[int],
) -> np.ndarray:
    """Write a video; return counts of the sampled frames' levels, int64 [3, 256], RGB.

    The places of images in another shape than `size` are added to `stretched`; `done` takes a step
    for each image.
    """
    counts = np.zeros((3, 256), np.int64)
    with video_writer(path, size, rate, crf) as video:
        for frame, (row, _) in enumerate(zip(rows, done, strict=False)):
            image_path = recording.images[row, CAMERAS.index(camera)]
            try:
                image = read_image(image_path)
            except ValueError as error:
                raise InputError(
                    f"{recording.place(row)}: {image_path}: {error}; drop the row: drivezoo edit"
                ) from None
            if abs(image.shape[1] * size[1] / (image.shape[0] * size[0]) - 1) > MOST_STRETCH:
                stretched.append(recording.place(row))
            image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
            video.add(image)
            if frame % SAMPLED_FRAMES == 0:
                pixels = image[::SAMPLED_PIXELS, ::SAMPLED_PIXELS].reshape(-1, 3)
                counts += [np.bincount(channel, minlength=256) for channel in pixels.T]
    return counts


def _about_episode(
    number: int,
    rows: range,
    columns: dict[str, np.ndarray],
    counts: dict[str, list[np.ndarray]],
    rate: int,
    task: str,
) -> dict[str, Any]:
    """Return an episode's rows, places of its videos, and statistics."""
    about: dict[str, Any] = {
        "episode_index": number,
        "tasks": [task],
        "length": len(rows),
        "data/chunk_index": 0,
        "data/file_index": 0,
        "dataset_from_index": rows.start,
        "dataset_to_index": rows.stop,
    }
    for camera in counts:
        key = f"videos/{CAMERA_PREFIX}{camera}"
        about[f"{key}/chunk_index"], about[f"{key}/file_index"] = divmod(number, CHUNK)
        about[f"{key}/from_timestamp"] = 0.0
        about[f"{key}/to_timestamp"] = len(rows) / rate
    for feature, stats in _stats(columns, rows, counts, range(number, number + 1)).items():
        about |= {f"stats/{feature}/{name}": value for name, value in stats.items()}
    return about | {"meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0}


def _stats(
    columns: dict[str, np.ndarray],
    rows: range,
    counts: dict[str, list[np.ndarray]],
    episodes: range,
) -> dict[str, dict]:
    """Return the statistics of some rows, and of some episodes' frames."""
    stats = {
        name: _column_stats(column[rows.start : rows.stop]) for name, column in columns.items()
    }
    frames = columns["frame_index"][rows.start : rows.stop]
    sampled = {"count": [int((frames % SAMPLED_FRAMES == 0).sum())]}
    for camera, of_episodes in counts.items():
        chosen = of_episodes[episodes.start : episodes.stop]
        stats[CAMERA_PREFIX + camera] = _pixel_stats(np.sum(chosen, 0)) | sampled
    return stats


def _column_stats(values: np.ndarray) -> dict[str, list]:
    """Return a feature's statistics, float [N] or [N, D], as lists of D numbers."""
    table = values.reshape(len(values), -1).astype(float)
    statistics = {
        "min": table.min(0),
        "max": table.max(0),
        "mean": table.mean(0),
        "std": table.std(0),
        **{name: np.quantile(table, share, axis=0) for name, share in QUANTILES.items()},
    }
    return {name: row.tolist() for name, row in statistics.items()} | {"count": [len(table)]}


def _pixel_stats(counts: np.ndarray) -> dict[str, list]:
    """Return the statistics of pixels in 0..1, as [3][1][1], as LeRobot shapes them."""
    levels = np.arange(256) / 255
    total = counts.sum(1)
    mean = counts @ levels / total
    statistics = {
        "min": levels[(counts > 0).argmax(1)],
        "max": levels[255 - (counts[:, ::-1] > 0).argmax(1)],
        "mean": mean,
        "std": np.sqrt(np.maximum(counts @ levels**2 / total - mean**2, 0)),
    }
    for name, share in QUANTILES.items():
        statistics[name] = levels[(counts.cumsum(1) >= share * total[:, None]).argmax(1)]
    return {name: row.reshape(3, 1, 1).tolist() for name, row in statistics.items()}


def _data_table(columns: dict[str, np.ndarray], pyarrow: Any) -> Any:
    arrays = {name: pyarrow.array(column.ravel()) for name, column in columns.items()}
    for name, column in columns.items():
        if column.ndim > 1:
            arrays[name] = pyarrow.FixedSizeListArray.from_arrays(arrays[name], column.shape[1])
    return pyarrow.table(arrays)


def _task_table(task: str, pyarrow: Any) -> Any:
    """Return the tasks as pandas writes them: the words are the index, which LeRobot reads."""

    def about(name: str | None, kind: str, numpy_kind: str, metadata: dict | None = None) -> dict:
        named = {"name": name, "field_name": name, "pandas_type": kind}
        return named | {"numpy_type": numpy_kind, "metadata": metadata}

    pandas = {
        "index_columns": ["task"],
        "column_indexes": [about(None, "unicode", "object", {"encoding": "UTF-8"})],
        "columns": [about("task_index", "int64", "int64"), about("task", "unicode", "object")],
        "creator": {"library": "pyarrow", "version": pyarrow.__version__},
        "pandas_version": "2.0.0",
    }
    table = pyarrow.table({"task_index": pyarrow.array([0]), "task": pyarrow.array([task])})
    return table.replace_schema_metadata({"pandas": json.dumps(pandas)})


def _info(
    columns: dict[str, np.ndarray],
    cameras: list[str],
    size: tuple[int, int],
    episodes: int,
    rate: int,
) -> dict:
    """Return the contents of `info.json`; `size` is the images' width and height."""
    width, height = size
    names = {ACTION: list(ACTIONS), STATE: list(STATES)}
    features: dict[str, dict] = {}
    for name, column in columns.items():
        shape = list(column.shape[1:]) or [1]
        features[name] = {"dtype": str(column.dtype), "shape": shape, "names": names.get(name)}
    video = {
        "video.height": height,
        "video.width": width,
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
            "shape": [height, width, 3],
            "names": ["height", "width", "channels"],
            "info": video,
        }
    return {
        "codebase_version": VERSION,
        "robot_type": ROBOT,
        "total_episodes": episodes,
        "total_frames": len(columns["index"]),
        "total_tasks": 1,
        "chunks_size": CHUNK,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": rate,
        "splits": {"train": f"0:{episodes}"},
        "data_path": DATA_PATH,
        "video_path": VIDEO_PATH,
        "features": features,
    }

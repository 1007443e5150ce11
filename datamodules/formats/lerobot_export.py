"""Write a recording as a LeRobotDataset v3: Parquet tables and a video for each camera."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from datamodules.driving_log import CAMERAS
from datamodules.formats.lerobot_features import (
    ACTION,
    ACTIONS,
    EXACT,
    INFO,
    MOST_S,
    STATE,
    STATS,
    TIME,
    load_pyarrow,
)
from datamodules.formats.lerobot_tables import (
    assign_video_files,
    dataset_features,
    dataset_info,
    dataset_stats,
    write_data,
    write_episodes,
    write_json,
    write_tasks,
    write_videos,
)
from datamodules.formats.recording_writer import Converted, left_out_note
from datamodules.image import find_file_fault
from datamodules.recording import Recording
from datamodules.stretches import continuous_drives, mean_rate
from zoo.base.errors import InputError
from zoo.base.new_folder import RECORDINGS, whole_folder
from zoo.base.rig import MPS_PER_MPH

MOST_FPS = 1000


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
    with whole_folder(out, RECORDINGS) as part:
        kept, left_out = _whole_rows(recording)
        cameras, notes = _cameras(kept)
        episodes = continuous_drives(kept, most=MOST_S * rate)
        files = assign_video_files(episodes, MOST_S * rate)
        columns = _columns(kept, episodes, rate)
        counts = {
            camera: write_videos(part, kept, camera, episodes, files, rate, crf, step)
            for camera, step in zip(cameras, _steps(progress, len(cameras)), strict=True)
        }
        features = dataset_features(columns, cameras, rate)
        (part / "meta").mkdir()
        write_data(part, columns, pyarrow)
        write_tasks(part, task, pyarrow)
        write_episodes(part, columns, counts, episodes, files, rate, task, pyarrow)
        write_json(part / STATS, dataset_stats(columns, slice(None), counts, range(len(episodes))))
        write_json(part / INFO, dataset_info(len(kept), len(episodes), rate, features))
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


def _steps(progress: Callable[[float], None], cameras: int) -> list[Callable[[float], None]]:
    def step(number: int) -> Callable[[float], None]:
        return lambda share: progress((number + share) / cameras)

    return [step(number) for number in range(cameras)]

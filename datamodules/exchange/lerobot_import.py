"""Read a LeRobotDataset v3, of drivezoo or of another program, and write it as a recording."""

import io
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from datamodules.bad_rows import BadRows
from datamodules.exchange.converted import Converted, left_out_note
from datamodules.exchange.driven_rows import (
    IMAGE_FOLDER,
    DrivenRows,
    Fit,
    size_note,
    times_of_drives,
    write_encoded,
    write_frame,
    write_log,
)
from datamodules.exchange.json_fields import number, parse
from datamodules.exchange.lerobot_features import Component, Meaning, find_meaning
from datamodules.exchange.lerobot_layout import (
    DATA,
    DATA_PATH,
    EPISODES,
    TIME,
    VERSION,
    VIDEO_PATH,
    load_pyarrow,
    video_file,
)
from datamodules.exchange.parquet_columns import REMEDY, encoded_images, read_table
from datamodules.exchange.video import read_frames
from datamodules.image import image_size
from datamodules.source_format import INFO, write_source
from zoo.base.bounded_files import MOST_JSON_BYTES, read_text
from zoo.base.errors import InputError
from zoo.base.limits import MOST, check_most
from zoo.base.new_folder import RECORDINGS, whole_folder

MOST_EPISODES = 1_000_000
MOST_NUMBER = 999_999  # of a chunk or a file


@dataclass(frozen=True)
class _Dataset:
    """A dataset's tables: labels by row, and what holds its images."""

    rows: DrivenRows
    episode: np.ndarray  # each row's episode_index, int64 [N]
    timestamp: np.ndarray  # seconds since the episode's start, float64 [N]
    files: list[Path]  # of the data, in order
    fps: float
    meaning: Meaning
    is_video: dict[str, bool]


@dataclass(frozen=True)
class _Images:
    """A camera's images to write: their files by row, and how to write them."""

    targets: dict[int, Path]
    fit: Fit
    quality: int
    progress: Callable[[float], None]


def import_lerobot(
    folder: Path,
    out: Path,
    steering: str | None = None,
    camera: str | None = None,
    speed_unit: str = "mps",
    fit: Fit = "keep",
    quality: int = 95,
    progress: Callable[[float], None] = lambda share: None,
    on_bad_row: str = "fail",
) -> Converted:
    """Write a dataset's rows as a recording; each episode is a continuous drive.

    The columns `steering`, `throttle`, `brake`, `speed_mph` and `time_s` of drivezoo's own datasets
    come back to the bit. Otherwise, numbers are found by their names.

    Args:
        folder: folder of the dataset.
        out: new folder.
        steering: number that steers, `action:0`; None finds it by its name.
        camera: key of the centre camera; None finds it by its name.
        speed_unit: `mph`, `mps` or `kmh`, for a speed whose name has no unit.
        fit: `keep` or `pad`, see `datamodules.exchange.driven_rows`.
        quality: quality of the written JPEGs, 1..100.
        progress: function called with the finished share, 0..1.
        on_bad_row: `fail`, or `skip` a row with a value that no log may have.

    Raises:
        InputError: pyarrow is missing, a file is missing or damaged, a value is wrong, or `out`
            exists.
        UsageError: `steering` or `camera` does not exist.
    """
    pyarrow = load_pyarrow()
    with whole_folder(out, RECORDINGS) as part:
        dataset = _read_dataset(folder, steering, camera, speed_unit, pyarrow)
        bad = BadRows(on_bad_row)
        good = dataset.rows.good_rows(bad)
        rows = dataset.rows.keep(good)
        (part / IMAGE_FOLDER).mkdir()
        stems = rows.stems()
        columns: list[list[str]] = []
        size = (2, 1)
        cameras = [key for key in dataset.meaning.cameras if key]
        for name, key in zip(("center", "left", "right"), dataset.meaning.cameras, strict=True):
            if key is None:
                columns.append([""] * len(rows))
                continue
            suffix = ".jpg" if dataset.is_video[key] else _suffix(dataset, key, pyarrow)
            columns.append([f"{name}_{stem}{suffix}" for stem in stems])
            names = columns[-1]
            targets = {row: part / IMAGE_FOLDER / names[at] for at, row in enumerate(good)}
            first = cameras.index(key)

            def report(share: float, first: int = first) -> None:
                progress((first + share) / len(cameras))

            write = _write_video if dataset.is_video[key] else _write_images
            images = _Images(targets, fit, quality, report)
            found = write(folder, dataset, key, images, pyarrow)
            size = found if name == "center" else size
        write_log(part, rows, list(zip(*columns, strict=True)))
        if dataset.meaning.steering.key != "steering":  # that of drivezoo's own datasets
            write_source(part, "lerobot")
    notes = left_out_note(bad.faults, "they cannot be read")
    notes += _notes(dataset.meaning, speed_unit) + size_note(*size, fit)
    return Converted(out, len(rows), rows.drives(), tuple(notes))


def _notes(meaning: Meaning, speed_unit: str) -> list[str]:
    notes = []
    if meaning.steering.key != "steering":
        notes.append(f"steering is {meaning.steering} ({meaning.steering.name or 'no name'})")
    missing = [one for one in ("throttle", "brake", "speed") if getattr(meaning, one) is None]
    if missing:
        notes.append(f"the dataset has no {', '.join(missing)}: 0 in each row")
    if meaning.assumed_unit:
        notes.append(f"the speed {meaning.speed} is taken for {speed_unit} (speed_unit=)")
    return notes


def _read_dataset(
    folder: Path, steering: str | None, camera: str | None, speed_unit: str, pyarrow: Any
) -> _Dataset:
    place = folder / INFO
    info = parse(read_text(place, MOST_JSON_BYTES), str(place), dict)
    if not str(info.get("codebase_version")).startswith("v3."):
        raise InputError(
            f"{place}: codebase_version is {info.get('codebase_version')!r:.20}, expected "
            f"{VERSION}; convert the dataset with LeRobot's convert_dataset_v21_to_v30"
        )
    # Other patterns are refused: a pattern of somebody else could lead anywhere.
    for key, pattern in (("data_path", DATA_PATH), ("video_path", VIDEO_PATH)):
        if info.get(key) not in (pattern, None):
            raise InputError(f"{place}: {key} is {info[key]!r:.80}, expected {pattern}; correct it")
    features = info.get("features")
    if not isinstance(features, dict) or not all(isinstance(x, dict) for x in features.values()):
        raise InputError(f"{place}: features is no object of objects; {REMEDY}")
    fps = number(info, "fps", str(place))
    if not 0 < fps <= 1000:
        raise InputError(f"{place}: fps is {fps:g}, beyond 0..1000; correct it")
    meaning = find_meaning(features, str(place), steering, camera, speed_unit)
    files = sorted((folder / DATA).glob("chunk-*/file-*.parquet"))
    if not files:
        raise InputError(f"{folder / DATA}: holds no chunk-000/file-000.parquet; {REMEDY}")
    roles = {name: getattr(meaning, name) for name in ("steering", "throttle", "brake", "speed")}
    names = ["episode_index", "timestamp", *(one.key for one in roles.values() if one)]
    own_time = TIME in features
    tables = [
        read_table(path, [*dict.fromkeys(names), *([TIME] if own_time else [])], pyarrow)
        for path in files
    ]
    check_most("rows", sum(len(one["timestamp"]) for one in tables), folder, "divide the dataset")
    places = [
        f"{path}, row {row}"
        for path, table in zip(files, tables, strict=True)
        for row in range(1, len(table["timestamp"]) + 1)
    ]
    if not places:
        raise InputError(f"{files[0]}: no rows; {REMEDY}")

    def column(key: str, position: int = 0) -> np.ndarray:
        return np.concatenate([_component(table[key], position) for table in tables])

    def values(one: Component | None) -> np.ndarray:
        return column(one.key, one.position) if one else np.zeros(len(places))

    episode = column("episode_index").astype(np.int64)
    timestamp = column("timestamp")
    rows = DrivenRows(
        steering=values(roles["steering"]),
        throttle=values(roles["throttle"]),
        brake=values(roles["brake"]),
        speed_mph=np.abs(values(roles["speed"])) * meaning.mph,
        time_s=column(TIME) if own_time else times_of_drives(episode, timestamp),
        places=places,
    )
    is_video = {key: one.get("dtype") == "video" for key, one in features.items()}
    return _Dataset(rows, episode, timestamp, files, fps, meaning, is_video)


def _component(table: np.ndarray, position: int) -> np.ndarray:
    return table if table.ndim == 1 else table[:, min(position, table.shape[1] - 1)]


def _write_video(
    folder: Path, dataset: _Dataset, key: str, images: _Images, pyarrow: Any
) -> tuple[int, int]:
    """Write a camera's images from its videos; return their width and height."""
    wanted: dict[Path, dict[int, list[int]]] = defaultdict(lambda: defaultdict(list))
    starts = _video_starts(folder, dataset, key, pyarrow)
    for row, (episode, timestamp) in enumerate(
        zip(dataset.episode.tolist(), dataset.timestamp.tolist(), strict=True)
    ):
        if row not in images.targets:
            continue
        if episode not in starts:
            raise InputError(
                f"{dataset.rows.places[row]}: episode {episode} is not in {folder / EPISODES}; "
                f"{REMEDY}"
            )
        path, start = starts[episode]
        moment = (start + timestamp) * dataset.fps
        if not -0.5 <= moment < MOST["rows"]:
            raise InputError(
                f"{dataset.rows.places[row]}: timestamp is {timestamp:g} s; correct the row"
            )
        wanted[path][round(moment)].append(row)
    done, size = 0, (2, 1)
    for path, frames in wanted.items():
        last, count = max(frames), 0
        for count, frame in enumerate(read_frames(path), 1):
            size = frame.shape[1], frame.shape[0]
            for row in frames.get(count - 1, ()):
                write_frame(frame, images.targets[row], images.quality, images.fit)
                done += 1
                images.progress(done / len(images.targets))
            if count > last:
                break
        if count <= last:
            row = next(rows[0] for frame, rows in frames.items() if frame >= count)
            raise InputError(
                f"{path}: the video has {count:,} frames, but {dataset.rows.places[row]} needs "
                f"frame {next(f for f in frames if f >= count) + 1:,}; {REMEDY}"
            )
    return size


def _video_starts(
    folder: Path, dataset: _Dataset, key: str, pyarrow: Any
) -> dict[int, tuple[Path, float]]:
    """Return each episode's video file and its first frame's time in it."""
    paths = sorted((folder / EPISODES).glob("chunk-*/file-*.parquet"))
    if not paths:
        raise InputError(f"{folder / EPISODES}: holds no chunk-000/file-000.parquet; {REMEDY}")
    about = [f"videos/{key}/{name}" for name in ("chunk_index", "file_index", "from_timestamp")]
    starts = {}
    for path in paths:
        table = read_table(path, ["episode_index", *about], pyarrow)
        columns = [_component(table[name], 0).tolist() for name in ("episode_index", *about)]
        for row, (episode, chunk, file, start) in enumerate(zip(*columns, strict=True), 1):
            whole = all(0 <= one <= MOST_NUMBER and one == int(one) for one in (chunk, file))
            if not whole or not 0 <= start < MOST["rows"]:
                raise InputError(f"{path}, row {row}: no place of a video; {REMEDY}")
            starts[int(episode)] = folder / video_file(key, int(chunk), int(file)), start
    return starts


def _write_images(
    folder: Path, dataset: _Dataset, key: str, images: _Images, pyarrow: Any
) -> tuple[int, int]:
    """Write a camera's images that the data holds; return their width and height."""
    size = (2, 1)
    for row, data in enumerate(encoded_images(dataset.files, key, pyarrow)):
        if row not in images.targets:
            continue
        try:
            write_encoded(data, images.targets[row], images.quality, images.fit)
            size = image_size(io.BytesIO(data))
        except (TypeError, ValueError) as error:
            raise InputError(
                f"{dataset.rows.places[row]}: {key}: {error}; delete the row"
            ) from None
        images.progress(row / len(images.targets))
    return size


def _suffix(dataset: _Dataset, key: str, pyarrow: Any) -> str:
    first = next(encoded_images(dataset.files, key, pyarrow), b"")
    return ".png" if first.startswith(b"\x89PNG") else ".jpg"

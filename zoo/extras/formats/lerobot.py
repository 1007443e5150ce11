"""The format LeRobotDataset 2.0, 2.1 and 3, of drivezoo or of another program."""

from collections import Counter
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from datamodules.driving_log import BadRows
from datamodules.format_options import ReadOptions
from datamodules.formats.json_fields import number, parse
from datamodules.formats.parquet_columns import (
    REMEDY,
    component,
    encoded_images,
    open_parquet,
    read_table,
)
from datamodules.image import ForwardReader, StoredImage
from datamodules.recording import (
    Recording,
    indices,
    keep_valid,
    make_recording,
)
from datamodules.stretches import times_of_drives
from zoo.base.bounded_files import MOST_JSON_BYTES, read_text
from zoo.base.errors import InputError
from zoo.base.limits import MOST, check_most
from zoo.base.rig import UDACITY
from zoo.extras.formats.lerobot_export import write as write
from zoo.extras.formats.lerobot_features import (
    DATA,
    DATA_PATH,
    EPISODES,
    INFO,
    OLD_DATA_PATH,
    OLD_EPISODES,
    OLD_VIDEO_PATH,
    ROBOT,
    TIME,
    VERSION,
    VIDEO_PATH,
    Meaning,
    find_meaning,
    video_file,
)
from zoo.extras.formats.video_frames import read_frames

keys = ("fps", "crf", "task")  # of `WriteOptions`
title = "LeRobotDataset"
uses = ("steering", "camera", "speed_unit")  # of `ReadOptions`; steering is a name
MOST_NUMBER = 999_999  # of a chunk or a file


def detect(path: Path) -> bool:
    """Return whether a folder holds a dataset's description."""
    return (path / INFO).exists()


def read(path: Path, options: ReadOptions) -> Recording:
    """Return a dataset's rows; each episode is a continuous drive.

    The columns `steering`, `throttle`, `brake`, `speed_mph` and `time_s` of drivezoo's own datasets
    come back to the bit. Otherwise, numbers are found by their names.

    Raises:
        InputError: pyarrow is missing, a file is missing or damaged, or a value is wrong.
        UsageError: the steering or the camera that the user names does not exist.
    """
    info = _read_info(path)
    features, path_of_info = info["features"], str(path / INFO)
    meaning = find_meaning(
        features, path_of_info, options.steering_name, options.camera, options.speed_unit
    )
    is_old = str(info["codebase_version"]).startswith("v2.")
    first = "episode_000000" if is_old else "file-000"
    files = sorted((path / DATA).glob(f"chunk-*/{first.rstrip('0')}*.parquet"))
    if not files:
        raise InputError(f"{path / DATA}: holds no chunk-000/{first}.parquet; {REMEDY}")
    times = [TIME] if TIME in features else []
    keys = ["episode_index", "timestamp", *times, *(part.key for part in meaning.roles.values())]
    tables = [read_table(file, [*dict.fromkeys(keys)]) for file in files]
    lengths = [len(table["timestamp"]) for table in tables]
    check_most("rows", sum(lengths), path, "divide the dataset")
    if not sum(lengths):
        raise InputError(f"{files[0]}: no rows; {REMEDY}")

    def column(key: str, position: int = 0) -> np.ndarray:
        columns = [
            component(table[key], file, key, position)
            for file, table in zip(files, tables, strict=True)
        ]
        return np.concatenate(columns)

    episode, timestamp = indices(column("episode_index")), column("timestamp")
    numbers = {role: column(part.key, part.position) for role, part in meaning.roles.items()}
    if options.unit:
        numbers["steering"] = options.unit.steering(numbers["steering"])
    if "speed" in numbers:
        numbers["speed_mph"] = np.abs(numbers.pop("speed")) * meaning.mph
    numbers["time_s"] = column(TIME) if times else times_of_drives(episode, timestamp)
    rows = [(file, row) for file, count in zip(files, lengths, strict=True) for row in range(count)]
    recording = make_recording(
        path,
        numbers,
        {},
        places=np.array([f"{file}, row {row + 1}" for file, row in rows], object),
        notes=tuple(_notes(meaning, options.speed_unit)),
        # The rig of other programs' datasets is unknown.
        rig=UDACITY if info.get("robot_type") == ROBOT else None,
    )
    bad = BadRows(options.on_bad_row)
    if fault := _size_fault(path, info, Counter(episode.tolist())):
        if options.on_bad_row == "fail":
            raise InputError(f"{fault}; {REMEDY}, or read what is there with data.on_bad_row=skip")
        bad.faults.append(fault)
    recording = keep_valid(recording, bad)
    for camera, key in enumerate(meaning.cameras):
        if key is None:
            continue
        is_video = features[key].get("dtype") == "video"
        videos: dict[int, tuple[Path, float]] = {}
        if is_video:
            videos = _old_videos(path, key) if is_old else _video_starts(path, key)
        reader = ForwardReader(read_frames if is_video else partial(encoded_images, key=key))
        for row, at_row in enumerate((recording.line - 1).tolist()):
            file, position = rows[at_row]
            if is_video:
                index, time_s, source = episode[at_row], timestamp[at_row], recording.place(row)
                if index not in videos:
                    raise InputError(
                        f"{source}: episode {index} is not in {path / EPISODES}; {REMEDY}"
                    )
                file, start = videos[index]
                frame = (start + time_s) * info["fps"]
                if not -0.5 <= frame < MOST["rows"]:
                    raise InputError(f"{source}: timestamp is {time_s:g} s; correct the row")
                position = round(frame)
            recording.images[row, camera] = StoredImage(str(file), position, reader, key)
    # A missing number: no window reaches from one episode into the next.
    return replace(recording, line=recording.line + episode[recording.line - 1])


def _size_fault(folder: Path, info: dict[str, Any], rows: Counter[int]) -> str:
    """Return in what the rows of each episode differ from what the dataset says, '' if in nothing.

    Args:
        folder: folder of the dataset.
        info: contents of `info.json`.
        rows: number of rows that were read of each episode.
    """
    stated: dict[int, int] = {}
    for path in sorted((folder / EPISODES).glob("chunk-*/file-*.parquet")):
        if "length" in open_parquet(path, ()).schema_arrow.names:
            table = read_table(path, ["episode_index", "length"])
            columns = [indices(component(table[name], path, name)).tolist() for name in table]
            stated |= dict(zip(*columns, strict=True))
    path = folder / OLD_EPISODES
    lines = read_text(path, MOST_JSON_BYTES).splitlines() if path.is_file() else []
    for line, text in enumerate(lines, 1):
        source = f"{path}, row {line}"
        entry = parse(text, source, dict)
        stated[int(number(entry, "episode_index", source))] = int(number(entry, "length", source))
    total, read_rows = info.get("total_frames", rows.total()), f"{rows.total():,} rows"
    differing = [
        f"episode {episode} has {rows[episode]:,} rows of {stated.get(episode, 0):,}"
        for episode in sorted({*stated, *rows} if stated else ())
        if rows[episode] != stated.get(episode, 0)
    ]
    if total == rows.total() and not differing:
        return ""
    first = f" ({len(differing):,} episodes differ: {differing[0]})" if differing else ""
    return f"{folder / INFO}: total_frames is {total!r:.20}, and its files hold {read_rows}{first}"


def _notes(meaning: Meaning, speed_unit: str) -> list[str]:
    notes = [
        f"{role} is {part} ({part.name or 'no name'})"
        for role, part in meaning.roles.items()
        if part.key not in (role, f"{role}_mph")
    ]
    missing = [role for role in ("throttle", "brake", "speed") if role not in meaning.roles]
    if missing:
        notes.append(f"the dataset has no {', '.join(missing)}: 0 in each row")
    if meaning.assumed_unit:
        speed = meaning.roles["speed"]
        notes.append(f"the speed {speed} is taken for {speed_unit} (speed_unit=)")
    return notes


def _read_info(folder: Path) -> dict[str, Any]:
    """Return what `info.json` says, with checked `fps` and `features`."""
    file = folder / INFO
    info: dict[str, Any] = parse(read_text(file, MOST_JSON_BYTES), str(file), dict)
    version = str(info.get("codebase_version"))
    if not version.startswith(("v2.", "v3.")):
        raise InputError(
            f"{file}: codebase_version is {version!r:.20}, expected v2.0, v2.1 or {VERSION}; "
            "convert the dataset with LeRobot"
        )
    is_old = version.startswith("v2.")
    patterns = (OLD_DATA_PATH, OLD_VIDEO_PATH) if is_old else (DATA_PATH, VIDEO_PATH)
    # Other patterns are refused: a pattern of somebody else could lead anywhere.
    for key, pattern in zip(("data_path", "video_path"), patterns, strict=True):
        if info.get(key) not in (pattern, None):
            raise InputError(f"{file}: {key} is {info[key]!r:.80}, expected {pattern}; correct it")
    features = info.get("features")
    if not isinstance(features, dict) or not all(isinstance(x, dict) for x in features.values()):
        raise InputError(f"{file}: features is no object of objects; {REMEDY}")
    fps = number(info, "fps", str(file))
    if not 0 < fps <= 1000:
        raise InputError(f"{file}: fps is {fps:g}, beyond 0..1000; correct it")
    return info | {"fps": fps}


def _old_videos(folder: Path, key: str) -> dict[int, tuple[Path, float]]:
    """Return each episode's own video of versions 2, and 0, its first frame's time in it."""
    paths = (folder / "videos").glob(f"chunk-*/{key}/episode_*.mp4")
    numbers = ((path, path.stem.removeprefix("episode_")) for path in sorted(paths))
    return {int(number): (path, 0.0) for path, number in numbers if number.isdigit()}


def _video_starts(folder: Path, key: str) -> dict[int, tuple[Path, float]]:
    """Return each episode's video file and its first frame's time in it."""
    paths = sorted((folder / EPISODES).glob("chunk-*/file-*.parquet"))
    if not paths:
        raise InputError(f"{folder / EPISODES}: holds no chunk-000/file-000.parquet; {REMEDY}")
    about = [f"videos/{key}/{name}" for name in ("chunk_index", "file_index", "from_timestamp")]
    starts = {}
    for path in paths:
        table = read_table(path, ["episode_index", *about])
        columns = [component(table[name], path, name).tolist() for name in table]
        for row, (episode, chunk, file, start) in enumerate(zip(*columns, strict=True), 1):
            whole = all(
                0 <= part <= MOST_NUMBER and part == int(part) for part in (episode, chunk, file)
            )
            if not whole or not 0 <= start < MOST["rows"]:
                raise InputError(f"{path}, row {row}: no place of a video; {REMEDY}")
            starts[int(episode)] = folder / video_file(key, int(chunk), int(file)), start
    return starts

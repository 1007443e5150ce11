"""Small recordings in the formats of the extra, byte for byte as other projects write them."""

import functools
import json
import math
import subprocess
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
import pytest

from tests.foreign_recordings import ROWS, STEERING, frames, write_frames


def cached(write: Callable[[Path], Path]) -> Callable[[Path], Path]:
    """Return a writer that encodes a recording once, and copies its files after that."""

    @functools.cache
    def files() -> dict[Path, bytes]:
        with TemporaryDirectory() as name:
            folder = write(Path(name, "recording"))
            paths = [path for path in folder.rglob("*") if path.is_file()]
            return {path.relative_to(folder): path.read_bytes() for path in paths}

    @functools.wraps(write)
    def copy(folder: Path) -> Path:
        for path, data in files().items():
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            (folder / path).write_bytes(data)
        return folder

    return copy


def sullychen(folder: Path, right: float = 1.0, full: float = 540.0, zero: float = 0.0) -> Path:
    names = [f"{row}.jpg" for row in range(ROWS)]
    write_frames(folder, names, right)
    moments = [f"2018-07-01 17:09:{44 + row // 20}:{row % 20 * 50}" for row in range(ROWS)]
    rows = zip(names, zero + full * STEERING, moments, strict=True)
    lines = [f"{name} {degrees:.6f},{moment}\n" for name, degrees, moment in rows]
    (folder / "data.txt").write_text("".join(lines))
    return folder


@cached
def deeppicar(folder: Path) -> Path:
    folder.mkdir()
    video, motion_jpeg = folder / "out-video.avi", cv2.VideoWriter_fourcc(*"MJPG")
    writer = cv2.VideoWriter(str(video), cv2.CAP_OPENCV_MJPEG, motion_jpeg, 20.0, (160, 80))
    for frame in frames():
        writer.write(np.ascontiguousarray(frame))
    writer.release()
    rows = [
        f"{1650231487551 + 50 * row},{row + 1},{math.radians(30) * value!r}\n"
        for row, value in enumerate(STEERING.tolist())
    ]
    (folder / "out-key.csv").write_text("ts_micro,frame,wheel\n" + "".join(rows))
    return folder


def jetracer(folder: Path) -> Path:
    points = np.round(80 + 80 * STEERING).astype(int)
    tail = "d0f21c3e-5d5f-11ea-9d3c-1cbfc0f2a4a1"
    write_frames(folder, [f"{x}_{row:03d}_{tail}.jpg" for row, x in enumerate(points)])
    return folder


@cached
def comma2016(folder: Path) -> Path:
    h5py = pytest.importorskip("h5py")
    for name in ("camera", "log"):
        (folder / name).mkdir(parents=True)
    images = [cv2.cvtColor(cv2.resize(frame, (320, 160)), cv2.COLOR_BGR2RGB) for frame in frames()]
    with h5py.File(folder / "camera" / "2016-01-30--11-24-51.h5", "w") as file:
        file["X"] = np.stack(images).transpose(0, 3, 1, 2)
    with h5py.File(folder / "log" / "2016-01-30--11-24-51.h5", "w") as file:
        file["cam1_ptr"] = np.repeat(np.arange(ROWS, dtype=float), 5)  # the log has 100 Hz
        file["steering_angle"] = np.repeat(-500.0 * STEERING, 5)
        file["speed"] = np.full(5 * ROWS, 4.4704)
        file["times"] = np.arange(5 * ROWS) / 100
    return folder


@cached
def comma2k19(folder: Path) -> Path:
    signals = {
        "processed_log/CAN/steering_angle": -500.0 * STEERING,
        "processed_log/CAN/speed": np.full(ROWS, 4.4704),
    }
    times = 100 + np.arange(ROWS) / 20
    for name, value in signals.items():
        (folder / name).mkdir(parents=True)
        with (folder / name / "t").open("wb") as file:
            np.save(file, times)
        with (folder / name / "value").open("wb") as file:
            np.save(file, value[:, None] if "speed" in name else value)
    (folder / "global_pose").mkdir()
    with (folder / "global_pose" / "frame_times").open("wb") as file:
        np.save(file, times)
    write_hevc(folder / "video.hevc")
    return folder


def write_hevc(path: Path) -> None:
    import imageio_ffmpeg

    raw = b"".join(np.ascontiguousarray(frame).tobytes() for frame in frames())
    source = ["-f", "rawvideo", "-pix_fmt", "bgr24", "-s", "160x80", "-r", "20", "-i", "-"]
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", *source]
    command += ["-c:v", "libx265", "-x265-params", "log-level=none", "-f", "hevc", str(path)]
    subprocess.run(command, input=raw, check=True)


def described_images(folder: Path) -> Path:
    """Describe a LeRobot dataset of another program; return the path of its table."""
    features = {
        "action": {"dtype": "float32", "shape": [2], "names": ["steering", "throttle"]},
        "observation.images.front": {"dtype": "image", "shape": [160, 320, 3]},
    }
    info = {"codebase_version": "v3.0", "fps": 10, "features": features}
    for name in ("meta", "data/chunk-000"):
        (folder / name).mkdir(parents=True)
    (folder / "meta/info.json").write_text(json.dumps(info))
    return folder / "data/chunk-000/file-000.parquet"

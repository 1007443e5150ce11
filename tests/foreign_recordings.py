"""Small recordings in the formats of other projects, byte for byte as those write them."""

import math
import subprocess
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest

ROWS = 60
STEERING = np.sin(np.arange(ROWS) / 5) / 2  # share of full lock, right positive
NS = 1_479_425_441_182_877_835  # a time of the challenge


def write_frames(folder: Path, names: Sequence[str], right: float = 1.0) -> None:
    """Write images of a view that moves to the left while the car steers right."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, frame in zip(names, frames(right), strict=True):
        assert cv2.imwrite(str(folder / name), frame)


def frames(right: float = 1.0) -> list[np.ndarray]:
    scene = np.random.default_rng(0).integers(0, 256, (20, 200, 3), np.uint8)
    scene = cv2.resize(scene, (2000, 80), interpolation=cv2.INTER_LINEAR)
    places = 900 + np.cumsum(10 * right * np.r_[0, STEERING[:-1]]).astype(int)
    return [scene[:, place : place + 160] for place in places]


def driving_log(folder: Path, right: float = 1.0) -> Path:
    """Write a log as of Udacity's simulator."""
    names = [
        f"center_2020_01_01_12_00_{row // 20:02d}_{row % 20 * 50:03d}.jpg" for row in range(ROWS)
    ]
    write_frames(folder / "IMG", names, right)
    rows = [f"IMG/{name},,,{turn},0.2,0,9" for name, turn in zip(names, STEERING, strict=True)]
    (folder / "driving_log.csv").write_text("\n".join(rows) + "\n")
    return folder


def sullychen(folder: Path, right: float = 1.0, full: float = 540.0, zero: float = 0.0) -> Path:
    names = [f"{row}.jpg" for row in range(ROWS)]
    write_frames(folder, names, right)
    moments = [f"2018-07-01 17:09:{44 + row // 20}:{row % 20 * 50:03d}" for row in range(ROWS)]
    rows = zip(names, zero + full * STEERING, moments, strict=True)
    lines = [f"{name} {degrees:.6f},{moment}\n" for name, degrees, moment in rows]
    (folder / "data.txt").write_text("".join(lines))
    return folder


def challenge2_test(folder: Path) -> Path:
    stamps = [NS + 50_000_000 * row for row in range(ROWS)]
    write_frames(folder / "center", [f"{stamp}.jpg" for stamp in stamps])
    rows = [
        f"{at},{-8.2 * value!r},0\n" for at, value in zip(stamps, STEERING.tolist(), strict=True)
    ]
    text = "frame_id,steering_angle,public\n" + "".join(rows)
    (folder / "CH2_final_evaluation.csv").write_text(text)
    return folder


def challenge2_training(folder: Path) -> Path:
    names = "index,timestamp,width,height,frame_id,filename,angle,torque,speed,lat,long,alt"
    lines = [names]
    for side, later in (("left", 20_000_000), ("center", 0), ("right", 10_000_000)):
        stamps = [NS + 50_000_000 * row + later for row in range(ROWS)]
        write_frames(folder / side, [f"{stamp}.jpg" for stamp in stamps])
        for stamp, value in zip(stamps, STEERING.tolist(), strict=True):
            lines.append(
                f"2016-11-17 23:30:41,{stamp},640,480,{side}_camera,{side}/{stamp}.jpg,"
                f"{-8.2 * value!r},0.1,4.4704,37.4,-122.1,1"
            )
    (folder / "interpolated.csv").write_text("\n".join([*lines, ""]))
    return folder


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


def table(folder: Path) -> Path:
    names = [f"{row}.png" for row in range(ROWS)]
    write_frames(folder / "pics", names)
    rows = [f"pics\\{name},{value!r}" for name, value in zip(names, STEERING.tolist(), strict=True)]
    (folder / "my.csv").write_text("\n".join(["path,turn", *rows, ""]))
    return folder


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

"""Small recordings in the formats of other projects, byte for byte as those write them."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

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
    return [scene[:, column : column + 160] for column in places]


def driving_log(folder: Path, right: float = 1.0) -> Path:
    """Write a log as of Udacity's simulator."""
    names = [f"center_2020_01_01_12_00_{at // 20:02d}_{at % 20 * 50:03d}.jpg" for at in range(ROWS)]
    write_frames(folder / "IMG", names, right)
    rows = [f"IMG/{name},,,{turn},0.2,0,9" for name, turn in zip(names, STEERING, strict=True)]
    (folder / "driving_log.csv").write_text("\n".join(rows) + "\n")
    return folder


def challenge2_test(folder: Path) -> Path:
    stamps = [NS + 50_000_000 * row for row in range(ROWS)]
    write_frames(folder / "center", [f"{stamp}.jpg" for stamp in stamps])
    rows = [f"{at},{-8.2 * turn!r},0\n" for at, turn in zip(stamps, STEERING.tolist(), strict=True)]
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


def table(folder: Path, steering: np.ndarray = STEERING) -> Path:
    names = [f"{row}.png" for row in range(ROWS)]
    write_frames(folder / "pics", names)
    rows = [f"pics\\{name},{value!r}" for name, value in zip(names, steering.tolist(), strict=True)]
    (folder / "my.csv").write_text("\n".join(["path,turn", *rows, ""]))
    return folder

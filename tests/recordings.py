"""Small recordings in the format of the original simulator, with drawn images."""

import datetime
import functools
import shutil
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from datamodules.format_options import Converted, Progress, ReadOptions, WriteOptions
from datamodules.known_formats import writable_formats
from datamodules.recording import Recording
from datamodules.recording_format import read_recording
from zoo.base.rig import UDACITY

HEADER = "center,left,right,steering,throttle,brake,speed"
FIRST = datetime.datetime(2018, 7, 16, 17, 11, 43, 382_000)
FPS = 15
FOLDERS = {
    "windows": "C:\\Users\\Some One\\Desktop\\new track\\IMG\\",
    "macos": "/Users/someone/Desktop/new track/IMG/",
    "linux": "/home/someone/new track/IMG/",
    "relative": "IMG/",
}
# Shift of the road's near end in each camera, in pixels: the left camera sees it further right.
SIDEWAYS = {"center": 0, "left": 55, "right": -55}
HORIZON = 60


@dataclass(frozen=True)
class Written:
    """The contents that `write_recording` wrote, to compare with what is read.

    Attributes:
        folder: folder with `driving_log.csv` and `IMG`.
        stems: part of each row's file names, such as `2018_07_16_17_11_43_382`.
        steering, throttle, brake, speed_mph, time_s: values in the log, float64 [rows].
    """

    folder: Path
    stems: list[str]
    steering: np.ndarray
    throttle: np.ndarray
    brake: np.ndarray
    speed_mph: np.ndarray
    time_s: np.ndarray

    def image(self, row: int, camera: str = "center") -> Path:
        return self.folder / "IMG" / f"{camera}_{self.stems[row]}.jpg"

    @property
    def log(self) -> Path:
        return self.folder / "driving_log.csv"

    @property
    def views(self) -> Path:
        """Folder of decoded views (`data.cache`) that tests share, since decoding takes 0.2 s."""
        return self.folder.with_name("views")


def write_recording(
    folder: Path | str,
    rows: int = 120,
    header: bool = False,
    style: str = "windows",
    decimal_comma: bool = False,
    cameras: tuple[str, ...] = ("center", "left", "right"),
    seed: int = 0,
    speed: float = 20.0,
) -> Written:
    """Drive a winding road for `rows` frames at 15 Hz and record it in `folder`.

    The road bends as the steering does, so that a network can learn it; about a quarter of the
    steering is exactly 0.

    Args:
        folder: folder to write.
        rows: number of rows.
        header: whether the log has a header.
        style: style of the paths: `windows`, `macos`, `linux` (absolute paths of another machine)
            or `relative` (with a blank before left and right, as in Udacity's data).
        decimal_comma: whether numbers have a decimal comma.
        cameras: cameras with images; the others have an empty column.
        seed: random seed of steering, pedals and grass.
        speed: mean speed in mph; each row is within 1 mph of it.
    """
    folder = Path(folder)
    (folder / "IMG").mkdir(parents=True)
    rng = np.random.default_rng(seed)
    time = np.arange(rows) / FPS
    wave = np.sin(time * 1.1 + rng.uniform(0, 6.3)) + 0.5 * np.sin(time * 2.7 + rng.uniform(0, 6.3))
    bend = 0.5 * np.sign(wave) * np.maximum(np.abs(wave) - 0.4, 0)
    speeds = np.maximum(speed + np.sin(time + rng.uniform(0, 6.3)), 0)
    pressed = wave < 0.2
    columns = {
        "steering": bend,
        "throttle": np.where(pressed, rng.uniform(0.1, 1, rows), 0),
        "brake": np.where(~pressed & (wave > 1.2), rng.uniform(0.1, 1, rows), 0),
        "speed_mph": speeds,
    }
    texts = {name: [format_number(value) for value in column] for name, column in columns.items()}
    moments = [FIRST + datetime.timedelta(milliseconds=round(1000 * second)) for second in time]
    stems = [f"{moment:%Y_%m_%d_%H_%M_%S}_{moment.microsecond // 1000:03d}" for moment in moments]

    lines = [HEADER] if header else []
    for row, stem in enumerate(stems):
        fields = []
        for camera in SIDEWAYS:
            gap = " " if style == "relative" and camera != "center" else ""
            fields.append(f"{gap}{FOLDERS[style]}{camera}_{stem}.jpg" if camera in cameras else "")
        numbers = [texts[name][row] for name in columns]
        fields += [text.replace(".", ",") if decimal_comma else text for text in numbers]
        lines.append(",".join(fields))
    (folder / "driving_log.csv").write_text("\n".join(lines) + "\n", newline="")

    grass = _grass(rng).tobytes()
    travelled = np.cumsum(speeds) * 0.44704 / FPS
    for row, stem in enumerate(stems):
        for camera in cameras:
            at = float(bend[row]), SIDEWAYS[camera], float(travelled[row])
            (folder / "IMG" / f"{camera}_{stem}.jpg").write_bytes(_jpeg(*at, grass))
    utc = datetime.timezone.utc
    return Written(
        folder=folder,
        stems=stems,
        time_s=np.array([moment.replace(tzinfo=utc).timestamp() for moment in moments]),
        **{name: np.array([float(text) for text in column]) for name, column in texts.items()},
    )


def write_resized(source: Written, folder: Path, width: int, height: int) -> Written:
    """Copy a recording to a folder, with images of another size."""
    shutil.copytree(source.folder, folder)
    for path in folder.glob("IMG/*.jpg"):
        image = cv2.imread(str(path))
        cv2.imwrite(str(path), cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA))
    return replace(source, folder=folder)


def replace_in(path: Path, old: str, new: str) -> None:
    """Replace a text that a file has, wherever it stands."""
    text = path.read_text()
    assert old in text, old
    path.write_text(text.replace(old, new))


def format_number(value: float) -> str:
    """Return a float as C# writes it: up to seven digits, `5E-05` if small, no trailing zeros.

    >>> format_number(0.275), format_number(0.00005), format_number(0.0), format_number(30.0)
    ('0.275', '5E-05', '0', '30')
    """
    return f"{np.float32(value) + 0.0:.7G}"  # + 0.0: no "-0"


def draw_road(steering: float, sideways: int, travelled_m: float, grass: np.ndarray) -> np.ndarray:
    """Draw a road that bends to the right for steering > 0, as uint8 [160, 320, 3] RGB."""
    image = grass.copy()
    nearness = np.linspace(0, 1, 24)
    y = HORIZON + nearness * (160 - HORIZON)
    middle = 160 + 120 * steering * (1 - nearness) ** 2 + sideways * nearness
    half = 6 + 110 * nearness
    road = np.concatenate([np.stack([middle - half, y], 1), np.stack([middle + half, y], 1)[::-1]])
    cv2.fillPoly(image, [road.astype(np.int32)], (110, 110, 115))
    # The edges have red and white stripes, which move towards the car.
    distance = 40 / (nearness + 0.08)
    striped = ((distance + travelled_m) // 6).astype(int) % 2
    for edge in (middle - half, middle + half):
        points = np.stack([edge, y], 1).astype(np.int32)
        for index in range(len(y) - 1):
            colour = (200, 40, 40) if striped[index] else (230, 230, 230)
            width = 1 + int(6 * nearness[index])
            cv2.line(image, points[index].tolist(), points[index + 1].tolist(), colour, width)
    return image


@functools.lru_cache(maxsize=4000)
def _jpeg(steering: float, sideways: int, travelled_m: float, grass: bytes) -> bytes:
    """Return an encoded image, kept since most tests write the same recordings again."""
    ground = np.frombuffer(grass, np.uint8).reshape(160, 320, 3)
    image = draw_road(steering, sideways, travelled_m, ground)
    ok, data = cv2.imencode(".jpg", image[:, :, ::-1])
    assert ok
    return data.tobytes()


def _grass(rng: np.random.Generator) -> np.ndarray:
    image = np.empty((160, 320, 3), np.uint8)
    image[:HORIZON] = (120, 160, 220)
    image[HORIZON:] = (70, 120, 50)
    return np.clip(image + rng.integers(-12, 13, (160, 320, 1)), 0, 255).astype(np.uint8)


def write_as(
    name: str, recording: Recording, out: Path, progress: Progress = lambda _: None, **how: object
) -> Converted:
    """Write a recording in a format; `how` as in `WriteOptions`."""
    options = WriteOptions(**how)  # type: ignore[arg-type]
    return writable_formats()[name].write(recording, out, options, progress)


def convert_to_recording(
    source: Path, out: Path, options: ReadOptions | None = None, **how: object
) -> Converted:
    """Write a folder of any format as a log."""
    _, recording = read_recording(source, options or ReadOptions(on_bad_image="skip"))
    return write_as("udacity", recording, out, **how)


def recording_in_memory(
    steering: np.ndarray,
    speed_mph: float | np.ndarray = 20.0,
    sizes: tuple[int, ...] = (),
    cameras: tuple[str, ...] = ("center", "left", "right"),
) -> Recording:
    """Return a recording with these labels at 15 Hz; its image files do not exist.

    Args:
        steering: steering of each row, -1..1.
        speed_mph: speed of all rows or of each row.
        sizes: numbers of rows of several recordings; empty for one recording.
        cameras: cameras with images.
    """
    rows = len(steering)
    sizes = sizes or (rows,)
    number = np.repeat(np.arange(len(sizes)), sizes)
    images = np.empty((rows, 3), dtype=object)
    for column, camera in enumerate(SIDEWAYS):
        if camera in cameras:
            images[:, column] = [f"/lake/IMG/{camera}_{row}.jpg" for row in range(rows)]
    return Recording(
        names=tuple(f"/lake/{index}" for index in range(len(sizes))),
        recording=number,
        line=np.arange(1, rows + 1),
        images=images,
        steering=np.asarray(steering, dtype=float),
        throttle=np.full(rows, 0.5),
        brake=np.zeros(rows),
        speed_mph=np.broadcast_to(speed_mph, rows).astype(float),
        time_s=1.5e9 + np.arange(rows) / FPS,
        rig=UDACITY,
    )

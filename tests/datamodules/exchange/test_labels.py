"""Formats of labels beside images: units, signs, and files that are damaged or cut short."""

import math
import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest

from datamodules.read_options import ReadOptions
from datamodules.recording import LONG_DRIVE, Recording
from datamodules.recording_format import find_format
from datamodules.sign_evidence import find_sign_evidence
from zoo.base.errors import InputError

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


def read(folder: Path, **options: object) -> Recording:
    return find_format(folder)[1].read(folder, ReadOptions(**options))  # type: ignore[arg-type]


EXACT = {sullychen: 1e-6, jetracer: 0.01}  # what the text of a format leaves of the steering


@pytest.mark.parametrize(
    "write", [sullychen, challenge2_test, challenge2_training, deeppicar, comma2016, comma2k19]
)
def test_steering_is_a_share_of_full_lock_with_right_positive(
    write: Callable[[Path], Path], tmp_path: Path
) -> None:
    recording = read(write(tmp_path / "recording"))
    assert np.abs(recording.steering - STEERING).max() <= EXACT.get(write, 1e-9)
    assert np.diff(recording.time_s) == pytest.approx(0.05, abs=1e-3)
    assert recording.image(ROWS - 1).ndim == 3
    evidence = find_sign_evidence(recording)
    assert evidence.is_clear
    assert evidence.correlation > 0.8
    assert "right" in recording.notes[0]


@pytest.mark.parametrize("write", [challenge2_test, challenge2_training, comma2016, comma2k19])
def test_formats_of_long_drives_state_long_blocks(write: Callable, tmp_path: Path) -> None:
    found = read(write(tmp_path / "drive"))
    assert found.blocks == LONG_DRIVE


def test_points_of_a_jetracer_are_shares_of_half_the_width(tmp_path: Path) -> None:
    recording = read(jetracer(tmp_path / "recording"))
    points = [int(Path(path).name.partition("_")[0]) for path in recording.images[:, 0]]
    assert recording.steering == pytest.approx(np.array(points) / 80 - 1)
    assert np.isnan(recording.time_s).all()


def test_side_cameras_are_those_nearest_in_time(tmp_path: Path) -> None:
    recording = read(challenge2_training(tmp_path / "recording"))
    for row, (center, left, right) in enumerate(recording.images.tolist()):
        stamps = [int(Path(path).stem) for path in (center, left, right)]
        assert stamps[0] == NS + 50_000_000 * row
        assert [stamp - stamps[0] for stamp in stamps[1:]] == [20_000_000, 10_000_000]
    assert recording.speed_mph == pytest.approx(10)


def test_a_table_has_the_columns_that_the_user_names(tmp_path: Path) -> None:
    from datamodules.formats import table as reader

    folder = table(tmp_path / "recording")
    columns = {"image": "path", "steering": "turn"}
    recording = reader.read(folder, ReadOptions(columns=columns))
    assert recording.steering == pytest.approx(STEERING)
    assert recording.images[3, 0] == str(folder / "pics" / "3.png")
    with pytest.raises(InputError, match=r"my\.csv, row 1: the header path,turn has no column x"):
        reader.read(folder, ReadOptions(columns={**columns, "speed": "x"}))
    with pytest.raises(InputError, match=r"name its columns, data\.columns="):
        reader.read(folder, ReadOptions())


@pytest.mark.parametrize("stored", [False, True])
def test_a_parquet_table_names_or_holds_its_images(stored: bool, tmp_path: Path) -> None:
    pa = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    folder = table(tmp_path / "recording")
    names = [f"pics/{row}.png" for row in range(ROWS)]
    data = [{"bytes": (folder / name).read_bytes(), "path": "x"} for name in names]
    columns = {"turn": STEERING, "view": data if stored else names, "s": np.arange(ROWS) / 20}
    parquet.write_table(pa.table(columns), folder / "rows.parquet")
    said = {"columns": "{image: view, steering: turn, time: s}"}
    recording = read(folder / "rows.parquet", **said)
    assert recording.steering == pytest.approx(STEERING)
    last = cv2.imread(str(folder / names[-1]))[:, :, ::-1]
    np.testing.assert_array_equal(recording.image(ROWS - 1), last)
    with pytest.raises(InputError, match="no column other"):
        read(folder / "rows.parquet", columns={"image": "view", "steering": "other"})


def test_images_that_deny_the_sign_stop_and_name_the_key(tmp_path: Path) -> None:
    folder = sullychen(tmp_path / "recording", right=-1.0)
    with pytest.raises(InputError, match=r"images deny .*data\.steering=\{unit: deg, full: 540"):
        read(folder)
    unit = "{unit: deg, full: 540, right: negative}"
    assert read(folder, steering=unit).steering == pytest.approx(-STEERING, abs=1e-6)


def test_a_servo_in_the_layout_of_degrees_stops_and_names_the_key(tmp_path: Path) -> None:
    folder = sullychen(tmp_path / "recording", full=45.0, zero=90.0)
    with pytest.raises(InputError, match=r"mostly about .*\{unit: servo, zero: 90, full: 45"):
        read(folder)
    unit = {"unit": "servo", "full": 45, "zero": 90}
    assert read(folder, steering=unit).steering == pytest.approx(STEERING, abs=1e-6)


def test_degrees_under_a_name_of_radians_stop(tmp_path: Path) -> None:
    folder = challenge2_test(tmp_path / "recording")
    log = folder / "CH2_final_evaluation.csv"
    head, *rows = log.read_text().splitlines()
    fields = [row.split(",") for row in rows]
    rows = [f"{name},{math.degrees(float(angle))},{half}" for name, angle, half in fields]
    log.write_text("\n".join([head, *rows, ""]))
    with pytest.raises(InputError, match=r"not rad, 8\.2 at full lock"):
        read(folder)


def cut(log: Path) -> None:
    log.write_text(log.read_text()[:-20])


def lead_outside(log: Path) -> None:
    log.write_text(log.read_text().replace("\n3.jpg", "\n../3.jpg"))


def no_number(log: Path) -> None:
    log.write_text(log.read_text().replace("\n3.jpg ", "\n3.jpg x"))


def test_a_last_row_that_is_being_written_is_left_out(tmp_path: Path) -> None:
    folder = sullychen(tmp_path / "sullychen")
    cut(folder / "data.txt")
    assert len(read(folder)) == ROWS - 1
    folder = challenge2_test(tmp_path / "challenge")
    cut(folder / "CH2_final_evaluation.csv")
    assert len(read(folder)) == ROWS - 1


@pytest.mark.parametrize("damage", [lead_outside, no_number])
def test_a_bad_row_is_named_or_left_out(damage: Callable[[Path], None], tmp_path: Path) -> None:
    folder = sullychen(tmp_path / "recording")
    damage(folder / "data.txt")
    with pytest.raises(InputError, match=r"data\.txt, row 4: .*on_bad_row=skip"):
        read(folder)
    recording = read(folder, on_bad_row="skip")
    assert len(recording) == ROWS - 1
    assert "row 4" in recording.bad_rows[0]


def test_a_missing_image_is_named_or_its_row_is_left_out(tmp_path: Path) -> None:
    folder = sullychen(tmp_path / "recording")
    (folder / "7.jpg").unlink()
    with pytest.raises(InputError, match=r"data\.txt, row 8: no centre image .*on_bad_image=skip"):
        read(folder)
    recording = read(folder, on_bad_image="skip")
    assert len(recording) == ROWS - 1
    assert "row 8" in recording.bad_images[0]

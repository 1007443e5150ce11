"""The extra's formats: what every format promises, units, signs, and damaged files."""

import re
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from rich.console import Console

from datamodules.data_settings import DataSettings
from datamodules.edited_recording import write_edited
from datamodules.known_formats import OWN, own_formats
from datamodules.recording import LONG_DRIVE
from datamodules.recording_edits import Edits
from datamodules.recording_format import find_format, read_recordings
from tests.contracts.test_recordings import (
    check_a_bad_row,
    check_a_half_written_line,
    check_a_refused_folder_of_images,
    replace_once,
)
from tests.datamodules.exchange.test_labels import (
    check_shares_of_full_lock,
    check_without_rows,
    read,
)
from tests.datamodules.test_other_kinds import KINDS, POINTER, check_another_kind
from tests.datamodules.test_path_contents import refusal_of
from tests.datamodules.test_recording_sizes import check_an_unnamed_image, notes
from tests.foreign_recordings import ROWS, STEERING
from tests.recordings import write_as
from tests.zoo.extras.formats.rare_examples import RARE
from tests.zoo.extras.formats.rare_recordings import (
    comma2k19,
    comma2016,
    deeppicar,
    jetracer,
    sullychen,
)
from zoo.base.errors import InputError
from zoo.commands.check import check
from zoo.extras.formats.video_frames import read_frames

EVERY = pytest.mark.parametrize("name", RARE)


def test_the_examples_are_of_every_format() -> None:
    sources = own_formats()
    assert {*OWN, *RARE} <= set(sources)
    assert all(sources[name].__name__ == f"zoo.extras.formats.{name}" for name in RARE)


@EVERY
def test_a_bad_row_is_one_line_or_is_left_out_and_listed(name: str, tmp_path: Path) -> None:
    check_a_bad_row(name, RARE[name], tmp_path)


@EVERY
def test_a_folder_of_images_is_refused(name: str, tmp_path: Path) -> None:
    check_a_refused_folder_of_images(RARE[name][0](tmp_path / "recording"), {})


FILES = {
    "lerobot": "data/chunk-000/file-000.parquet",
    "sullychen": "data.txt",
    "deeppicar": "out-key.csv",
    "comma2016": "log/2016-01-30--11-24-51.h5",
    "comma2k19": "global_pose/frame_times",
}


@pytest.mark.parametrize("name", ["sullychen", "deeppicar"])
def test_a_last_line_that_is_half_written_is_no_error(name: str, tmp_path: Path) -> None:
    check_a_half_written_line(RARE[name], FILES[name], tmp_path)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", FILES)
def test_a_file_of_another_kind_is_named_by_contents(name: str, kind: str, tmp_path: Path) -> None:
    check_another_kind(name, RARE[name], FILES[name], kind, tmp_path)


@pytest.mark.parametrize("name", ["sullychen", "deeppicar"])
def test_the_table_of_a_format_names_its_folder(name: str, tmp_path: Path) -> None:
    folder = RARE[name][0](tmp_path / "recording")
    assert refusal_of(folder / FILES[name]).endswith(f"name {folder}")


@pytest.mark.parametrize("write", [sullychen, jetracer])
def test_an_image_that_no_row_names_is_counted(write: Callable, tmp_path: Path) -> None:
    check_an_unnamed_image(write(tmp_path / "recording"))


def test_images_of_an_hdf5_file_that_no_row_names_are_counted(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    folder = comma2016(tmp_path / "recording")
    assert "have no row" not in notes(folder)
    with h5py.File(next((folder / "log").iterdir()), "r+") as file:
        file["cam1_ptr"][:] = np.minimum(file["cam1_ptr"][:], ROWS - 2)
    assert "1 of 60 images in" in notes(folder)


EXACT = {sullychen: 1e-6}  # what the text of a format leaves of the steering


@pytest.mark.parametrize("write", [sullychen, deeppicar, comma2016, comma2k19])
def test_steering_is_a_share_of_full_lock_with_right_positive_and_long_drives_have_long_blocks(
    write: Callable[[Path], Path], tmp_path: Path
) -> None:
    recording = read(write(tmp_path / "recording"))
    check_shares_of_full_lock(recording, EXACT.get(write, 1e-9))
    assert (recording.blocks == LONG_DRIVE) == (write is not deeppicar)


def test_50_milliseconds_without_a_leading_zero_are_not_half_a_second(tmp_path: Path) -> None:
    times = read(sullychen(tmp_path / "recording")).time_s
    assert np.diff(times) == pytest.approx(np.full(ROWS - 1, 0.05), abs=1e-6)


def test_a_deeppicars_microseconds_are_known_by_their_steps(tmp_path: Path) -> None:
    folder = deeppicar(tmp_path / "recording")
    times, log = read(folder).time_s, folder / "out-key.csv"
    log.write_text(re.sub(r"(?m)^\d+", r"\g<0>000", log.read_text()))
    assert (read(folder).time_s == times).all()


@pytest.mark.parametrize("full", [1, 100])
def test_a_later_deeppicar_has_another_clock_name_and_throttle(full: float, tmp_path: Path) -> None:
    folder = deeppicar(tmp_path / "recording")
    times, (_, *rows) = read(folder).time_s, (folder / "out-key.csv").read_text().splitlines()
    lines = ["ts,frame,wheel,ai,throttle", *(f"{row},0.1,{0.5 * full}" for row in rows)]
    (folder / "out-key.csv").write_text("\n".join(lines) + "\n")
    recording = read(folder)
    assert (recording.throttle == 0.5).all()
    assert (recording.time_s == times).all()


def test_points_of_a_jetracer_are_shares_of_half_the_width(tmp_path: Path) -> None:
    recording = read(jetracer(tmp_path / "recording"))
    points = [int(Path(path).name.partition("_")[0]) for path in recording.images[:, 0]]
    assert recording.steering == pytest.approx(np.array(points) / 80 - 1)
    assert np.isnan(recording.time_s).all()


def test_each_image_of_a_jetracer_has_its_own_width(tmp_path: Path) -> None:
    folder = jetracer(tmp_path / "recording")
    steering = read(folder).steering
    for path in sorted(folder.iterdir())[1::2]:
        x, _, rest = path.name.partition("_")
        image = cv2.resize(cv2.imread(str(path)), None, fx=3, fy=3)
        cv2.imwrite(str(path.with_name(f"{3 * int(x)}_{rest}")), image)
        path.unlink()
    assert sorted(read(folder).steering) == pytest.approx(sorted(steering))


def test_images_with_capital_suffixes_are_detected(tmp_path: Path) -> None:
    folder = jetracer(tmp_path / "recording")
    for image in list(folder.iterdir()):
        image.rename(image.with_suffix(".JPG"))
    assert find_format(folder)[0] == "named_images"
    assert len(read(folder)) == ROWS


def test_images_that_deny_the_sign_stop_and_name_the_key(tmp_path: Path) -> None:
    folder = sullychen(tmp_path / "recording", right=-1.0)
    unit = "{unit: deg, full: 540.0, right: negative}"
    with pytest.raises(InputError, match=rf'images deny .*"data\.steering={unit}"'):
        read(folder)
    assert read(folder, steering=unit).steering == pytest.approx(-STEERING, abs=1e-6)


def test_an_image_of_sullychen_has_blanks_and_the_last_row_no_end(tmp_path: Path) -> None:
    folder = sullychen(tmp_path / "recording")
    steering, log = read(folder).steering, folder / "data.txt"
    for image in list(folder.glob("*.jpg")):
        image.rename(image.with_name(f"my drive.png {image.name}"))
    log.write_text(re.sub(r"(?m)^", "my drive.png ", log.read_text().rstrip("\n")))  # no last end
    assert find_format(folder)[0] == "sullychen"
    assert read(folder).steering.tolist() == steering.tolist()


def test_a_servo_in_the_layout_of_degrees_stops_and_names_the_key(tmp_path: Path) -> None:
    folder = sullychen(tmp_path / "recording", full=45.0, zero=90.0)
    with pytest.raises(InputError, match=r"mostly about .*\{unit: servo, zero: 90, full: 45"):
        read(folder)
    unit = {"unit": "servo", "full": 45, "zero": 90}
    assert read(folder, steering=unit).steering == pytest.approx(STEERING, abs=1e-6)


WITHOUT_ROWS = {
    "comma2016": {},
    "named_images": {},
    "sullychen": {"data.txt": "0.jpg 1.5"},  # half written
    "deeppicar": {"out-key.csv": "ts_micro,frame,wheel\n"},
}


@pytest.mark.parametrize("name", WITHOUT_ROWS)
def test_a_recording_without_rows_is_refused(name: str, tmp_path: Path) -> None:
    check_without_rows(name, WITHOUT_ROWS[name], tmp_path)


def test_a_row_whose_image_lies_outside_is_named_or_left_out(tmp_path: Path) -> None:
    folder = sullychen(tmp_path / "recording")
    replace_once("\n3.jpg", "\n../3.jpg", "data.txt")(folder)
    with pytest.raises(InputError, match=r"data\.txt, row 4: .*on_bad_row=skip"):
        read(folder)
    recording = read(folder, on_bad_row="skip")
    assert len(recording) == ROWS - 1
    assert "row 4" in recording.bad_rows[0]


@pytest.mark.parametrize(("name", "file"), [("X", "camera"), ("steering_angle", "log")])
def test_hdf5_that_claims_a_billion_rows_is_refused(name: str, file: str, tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    folder = comma2016(tmp_path / "recording")
    path = next((folder / file).iterdir())
    with h5py.File(path, "r+") as opened:
        rest, kind = opened[name].shape[1:], opened[name].dtype
        del opened[name]
        opened.create_dataset(name, (10**9, *rest), kind, chunks=(1, *rest))
    assert path.stat().st_size < 10_000_000
    with pytest.raises(InputError, match=rf"{name} claims 1,000,000,000 rows.*divide"):
        read(folder, steering={"unit": "deg", "full": 500, "right": "negative"}).image(0)


def test_a_short_video_is_named_with_the_row(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    folder = deeppicar(tmp_path / "recording")
    with (folder / "out-key.csv").open("a") as file:
        file.writelines(f"{50 * row},{row + 1},0.1\n" for row in range(ROWS, ROWS + 2))
    pattern = rf"out-key\.csv, row {ROWS + 2}: .*it has {ROWS} images"
    settings = DataSettings(str(folder), colour="gray", size=(16, 32), cache=None)
    with pytest.raises(InputError, match=rf"{pattern}.*on_bad_image=skip"):
        settings.load(Console(quiet=True))
    assert not check(str(folder))
    printed = capsys.readouterr().out
    assert re.search(pattern, printed)
    assert "2 bad images; copy" in printed


def test_rows_beyond_the_end_of_a_video_are_left_out_of_copies(tmp_path: Path) -> None:
    folder = deeppicar(tmp_path / "recording")
    with (folder / "out-key.csv").open("a") as file:
        file.writelines(f"{50 * row},{row + 1},0.1\n" for row in range(ROWS, ROWS + 2))
    recording = read_recordings(str(folder))
    assert len(write_edited(recording, Edits(ROWS + 2), tmp_path / "edited").left_out) == 2
    for to in ("udacity", "donkeycar"):
        assert write_as(to, recording, tmp_path / to).rows == ROWS
    for name in ("edited", "udacity", "donkeycar"):
        assert len(read_recordings(str(tmp_path / name))) == ROWS


@pytest.mark.parametrize("video", ["out-video.avi", "video.hevc", "video.mp4"])
def test_a_video_of_another_kind_is_named_by_its_contents(video: str, tmp_path: Path) -> None:
    (tmp_path / video).write_bytes(POINTER)
    with pytest.raises(InputError, match=rf"{video}: is a Git LFS pointer"):
        next(read_frames(tmp_path / video))
    (tmp_path / video).write_bytes(b"")
    with pytest.raises(InputError, match=r" video, or damaged \([\w ]+\); copy it again$"):
        next(read_frames(tmp_path / video))

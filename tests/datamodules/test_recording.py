"""Folders as people have them, read on this machine, and the report of them."""

import os
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from datamodules.findings import report_lines, report_recordings
from datamodules.formats.udacity import times_from_names
from datamodules.recording import read_recordings
from tests.recordings import FOLDERS, Written, write_recording
from zoo.base.errors import InputError


def edit_log(folder: Path, old: str, new: str) -> None:
    log = folder / "driving_log.csv"
    assert old in log.read_text()
    log.write_text(log.read_text().replace(old, new, 1))


def refusal(*arguments, **settings) -> str:
    with pytest.raises(InputError) as caught:
        read_recordings(*arguments, **settings)
    message = str(caught.value)
    assert "\n" not in message
    return message


@pytest.mark.parametrize("header", [False, True], ids=["bare", "header"])
@pytest.mark.parametrize("style", FOLDERS)
def test_images_are_found_here_wherever_the_log_was_made(tmp_path, style, header):
    written = write_recording(tmp_path / "lake", rows=3, style=style, header=header)
    recording = read_recordings(str(written.folder))
    for row in range(3):
        for camera, name in enumerate(("center", "left", "right")):
            assert written.image(row, name).samefile(recording.images[row, camera])


def test_labels_with_decimal_commas_are_those_written(tmp_path):
    written = write_recording(tmp_path / "lake", rows=90, decimal_comma=True)
    assert len(written.log.read_text().splitlines()[1].split(",")) > 7
    recording = read_recordings(str(written.folder))
    for name in ("steering", "throttle", "brake", "speed_mph"):
        np.testing.assert_array_equal(getattr(recording, name), getattr(written, name))


@pytest.mark.parametrize("name", ["my lake", "lr=0.1,x", "[lake] {1}", "Straße %20 'n'"])
def test_folder_with_an_awkward_name(tmp_path, name):
    written = write_recording(tmp_path / name, rows=2)
    recording = read_recordings(str(written.folder))
    assert Path(recording.images[1, 2]).read_bytes() == written.image(1, "right").read_bytes()


def test_the_log_itself_may_be_named(tmp_path):
    written = write_recording(tmp_path / "lake", rows=2)
    assert len(read_recordings(str(written.log))) == 2


def test_several_folders_keep_which_is_which(tmp_path):
    one = write_recording(tmp_path / "one", rows=2, seed=1)
    two = write_recording(tmp_path / "two", rows=3, seed=2)  # the same file names as in one
    recording = read_recordings([str(one.folder), str(two.folder)])
    assert recording.recording.tolist() == [0, 0, 1, 1, 1]
    assert recording.names == (str(one.folder), str(two.folder))
    np.testing.assert_array_equal(recording.speed_mph[2:], two.speed_mph)
    assert Path(recording.images[0, 0]).read_bytes() == one.image(0).read_bytes()
    assert Path(recording.images[2, 0]).read_bytes() == two.image(0).read_bytes()
    assert recording.place(3) == f"{two.folder}/driving_log.csv, row 2"


def five_columns(folder: Path) -> None:
    log = folder / "driving_log.csv"
    rows = [line.replace(",,,", ",") for line in log.read_text().splitlines()]
    log.write_text("\n".join(["center,steering,throttle,brake,speed", *rows]))


def without_side_images(folder: Path) -> None:
    for image in folder.glob("IMG/[lr]*.jpg"):
        image.unlink()


@pytest.mark.parametrize(
    ("cameras", "change"),
    [
        (("center",), lambda folder: None),
        (("center",), five_columns),
        (("center", "left", "right"), without_side_images),
    ],
    ids=["empty columns", "five columns", "deleted images"],
)
def test_a_centre_only_recording_has_no_side_images(tmp_path, cameras, change):
    written = write_recording(tmp_path / "lake", rows=2, cameras=cameras)
    change(written.folder)
    recording = read_recordings(str(written.folder))
    assert recording.images[:, 1:].tolist() == [[None, None]] * 2
    np.testing.assert_array_equal(recording.steering, written.steering)


def test_centre_only_by_deleted_side_images(tmp_path):
    written = write_recording(tmp_path / "lake", rows=2)
    for image in written.folder.glob("IMG/[lr]*.jpg"):
        image.unlink()
    recording = read_recordings(str(written.folder))
    assert recording.images[:, 1:].tolist() == [[None, None]] * 2


def test_images_elsewhere(tmp_path):
    written = write_recording(tmp_path / "lake", rows=2)
    elsewhere = (written.folder / "IMG").rename(tmp_path / "all images")
    recording = read_recordings(str(written.folder), images=str(elsewhere))
    assert Path(recording.images[0, 0]).parent == elsewhere


def test_images_named_in_vain(tmp_path):
    written = write_recording(tmp_path / "lake", rows=2)
    message = refusal(str(written.folder), images=str(tmp_path / "nowhere"))
    assert f"{tmp_path}/nowhere: no such folder" in message


@pytest.mark.parametrize("place", ["img", "."], ids=["lower case", "beside the log"])
def test_images_in_another_folder_of_the_recording(tmp_path, place):
    written = write_recording(tmp_path / "lake", rows=2)
    (written.folder / "IMG").rename(written.folder / "img")
    for image in written.folder.glob("img/*.jpg"):
        image.rename(written.folder / place / image.name)
    recording = read_recordings(str(written.folder))
    assert Path(recording.images[0, 0]).parent == written.folder / place


def where_the_log_says(folder: Path) -> Path:
    """Move the images to the place that the log of this machine names."""
    there = (folder / "IMG").rename(folder.parent / "there")
    log = folder / "driving_log.csv"
    log.write_text(log.read_text().replace(FOLDERS["linux"], f"{there}/"))
    return there


@pytest.mark.parametrize(
    ("style", "move"),
    [
        ("windows", lambda folder: (folder / "IMG").rename(folder / "img")),
        ("windows", beside_the_log),
        ("windows", in_a_folder_per_lap),
        ("linux", where_the_log_says),
    ],
    ids=["lower case", "beside the log", "a folder per lap", "where the log says"],
)
def test_images_are_found_where_they_were_moved(tmp_path, style, move):
    written = write_recording(tmp_path / "lake", rows=2, style=style)
    there = move(written.folder)
    assert Path(read_recordings(str(written.folder)).images[0, 0]).parent == there


def test_a_typo_in_a_folder_names_the_nearest_recording(tmp_path):
    write_recording(tmp_path / "my_recording", rows=2)
    message = refusal(str(tmp_path / "my_recoding"))
    assert message.endswith(f"did you mean {tmp_path}/my_recording?")


def test_the_folder_of_the_images_names_the_recording(tmp_path):
    written = write_recording(tmp_path / "lake", rows=2)
    assert refusal(str(written.folder / "IMG")).endswith(f"name {written.folder}")


def test_folder_without_log(tmp_path):
    assert f"{tmp_path}: holds no driving_log.csv" in refusal(str(tmp_path))


def test_a_log_one_level_down_is_suggested(tmp_path):
    write_recording(tmp_path / "all [1]" / "lake", rows=2)
    message = refusal(str(tmp_path / "all [1]"))
    assert message.endswith(f"name {tmp_path}/all [1]/lake")


def test_of_several_logs_one_level_down_three_are_suggested(tmp_path):
    for name in "abcd":
        write_recording(tmp_path / name, rows=1)
    message = refusal(str(tmp_path))
    assert f"{tmp_path}/a, {tmp_path}/b, {tmp_path}/c (1 more)" in message
    assert f"{tmp_path}/d" not in message


@pytest.mark.parametrize("kind", ["pipe", "device", "folder"])
def test_an_image_that_is_no_regular_file_is_missing(tmp_path, kind):
    written = write_recording(tmp_path / "lake", rows=3)
    image = written.image(1)
    image.unlink()
    if kind == "pipe":
        os.mkfifo(image)
    elif kind == "device":
        image.symlink_to("/dev/zero")
    else:
        image.mkdir()
    assert f"{written.log}, row 2: no image {image.name}" in refusal(str(written.folder))
    recording = read_recordings(str(written.folder), on_bad_image="skip")
    assert recording.line.tolist() == [1, 3]


def test_an_image_may_be_a_link(tmp_path):
    written = write_recording(tmp_path / "lake", rows=2)
    elsewhere = written.image(1).rename(tmp_path / "elsewhere.jpg")
    written.image(1).symlink_to(elsewhere)
    assert len(read_recordings(str(written.folder))) == 2


def test_one_bad_folder_of_several_is_the_one_named(tmp_path):
    written = write_recording(tmp_path / "lake", rows=2)
    message = refusal([str(written.folder), str(tmp_path / "nowhere")])
    assert message.startswith(f"{tmp_path}/nowhere: ")


def test_empty_list_of_folders():
    assert "data.root is an empty list" in refusal([])


def test_missing_image_names_file_row_and_image(tmp_path):
    written = write_recording(tmp_path / "lake", rows=4)
    written.image(2, "left").unlink()
    message = refusal(str(written.folder))
    assert f"{written.log}, row 3: no image left_{written.stems[2]}.jpg" in message
    assert "(1 of 4 rows" in message
    recording = read_recordings(str(written.folder), on_bad_image="skip")
    assert recording.line.tolist() == [1, 2, 4]
    np.testing.assert_array_equal(recording.steering, np.delete(written.steering, 2))
    (line,) = recording.bad_images
    assert f"row 3: no image left_{written.stems[2]}.jpg" in line


def test_row_without_centre_image_is_bad(tmp_path):
    written = write_recording(tmp_path / "lake", rows=3)
    edit_log(written.folder, f"{FOLDERS['windows']}center_{written.stems[1]}.jpg", "")
    assert "row 2: names no centre image" in refusal(str(written.folder))
    recording = read_recordings(str(written.folder), on_bad_image="skip")
    assert recording.line.tolist() == [1, 3]


@pytest.mark.parametrize("on_bad_image", ["fail", "skip"])
def test_all_images_missing(tmp_path, on_bad_image):
    written = write_recording(tmp_path / "lake", rows=3)
    shutil.rmtree(written.folder / "IMG")
    message = refusal(str(written.folder), on_bad_image=on_bad_image)
    assert "row 1" in message
    assert "center_" in message


def test_fingerprint_stays_when_the_log_names_another_machine(tmp_path):
    one = write_recording(tmp_path / "one", rows=5, style="windows")
    two = write_recording(tmp_path / "two", rows=5, style="linux")
    recording = read_recordings(str(one.folder))
    before = recording.fingerprint()
    assert read_recordings(str(two.folder)).fingerprint() == before, "the log of another machine"
    assert recording.keep(np.arange(5) != 2).fingerprint() != before
    moved = one.folder.rename(tmp_path / "moved")
    assert read_recordings(str(moved)).fingerprint() == before
    for column in ("steering", "speed_mph"):
        edit_log(moved, f"{getattr(one, column)[3]:.7G}", "0.987")
        assert read_recordings(str(moved)).fingerprint() != before
        edit_log(moved, "0.987", f"{getattr(one, column)[3]:.7G}")


def test_times_are_those_in_the_file_names(recorded):
    recording = read_recordings(str(recorded.folder))
    np.testing.assert_allclose(recording.time_s, recorded.time_s, atol=1e-3)


def test_time_counts_from_1970():
    names = ["IMG/center_1970_01_02_00_00_01_250.jpg", "center_5.jpg"]
    np.testing.assert_array_equal(times_from_names(names), [86401.25, np.nan])


def test_impossible_month_is_no_time():
    assert np.isnan(times_from_names(["center_2018_13_01_00_00_00_000.jpg"])).all()


def test_the_real_recording_reads():
    lake = Path(__file__).parents[3] / "shared" / "data" / "lake"
    if not lake.exists():
        pytest.skip(f"{lake} is not here")
    recording = read_recordings(str(lake))
    assert len(recording) == 2700
    # awk -F, '$4+0==0' driving_log.csv | wc -l
    assert (recording.steering == 0).sum() == 1902
    assert all(Path(path).is_file() for path in recording.images[-1])


def rename_time(written: Written, row: int, stem: str) -> None:
    """Give a row another time, in its images' names and in the log."""
    for camera in ("center", "left", "right"):
        image = written.image(row, camera)
        image.rename(image.with_name(f"{camera}_{stem}.jpg"))
    written.log.write_text(written.log.read_text().replace(written.stems[row], stem))


def test_figures_of_one_recording(recorded):
    (report,) = report_recordings(read_recordings(str(recorded.folder)))
    assert (report.name, report.rows, report.side_cameras) == (str(recorded.folder), 120, 120)
    assert report.seconds == pytest.approx(119 / 15, abs=0.01)
    assert report.fps == pytest.approx(15, abs=0.3)
    assert report.gaps == 0
    assert report.zero_share == (recorded.steering == 0).mean() > 0.1
    assert report.mean_speed_mph == pytest.approx(np.mean(recorded.speed_mph))


@pytest.mark.parametrize("hour", [18, 17], ids=["pause", "step back"])
def test_a_pause_or_a_step_back_in_time_is_a_gap_and_no_driving(tmp_path, hour):
    written = write_recording(tmp_path / "lake", rows=30)
    rename_time(written, 29, f"2018_07_16_{hour}_00_00_000")
    (report,) = report_recordings(read_recordings(str(written.folder)))
    assert report.gaps == 1
    assert report.seconds == pytest.approx(28 / 15, abs=0.01)


def test_the_pause_between_two_recordings_is_nobodys_gap(tmp_path):
    folders = [write_recording(tmp_path / name, rows=9).folder for name in ("one", "two")]
    reports = report_recordings(read_recordings([str(folder) for folder in folders]))
    assert [report.rows for report in reports] == [9, 9]
    assert [report.gaps for report in reports] == [0, 0]


def test_names_without_times_have_no_seconds(tmp_path):
    written = write_recording(tmp_path / "lake", rows=3)
    for row in range(3):
        rename_time(written, row, str(row))
    recording = read_recordings(str(written.folder))
    (report,) = report_recordings(recording)
    assert np.isnan([report.seconds, report.fps]).all()
    assert "no times in the file names" in report_lines(recording)[0]


def test_a_line_a_recording_says_it_all(tmp_path):
    one = write_recording(tmp_path / "one", rows=60)
    two = write_recording(tmp_path / "two", rows=3, cameras=("center",))
    first, second = report_lines(read_recordings([str(one.folder), str(two.folder)]))
    assert first.startswith(f"{one.folder}: 60 rows, 3 cameras, 4 s at 14.9 frames/s")
    assert "0 gaps" in first
    assert f"{(one.steering == 0).mean():.0%} of steering exactly 0" in first
    assert re.search(r"mean (19|20|21)\.\d mph", first)
    assert second.startswith(f"{two.folder}: 3 rows, centre camera only")


def test_skipped_rows_are_counted(tmp_path):
    written = write_recording(tmp_path / "lake", rows=5)
    written.image(1).unlink()
    written.image(3).unlink()
    lines = report_lines(read_recordings(str(written.folder), on_bad_image="skip"))
    assert "skipped 2 rows with a bad image" in lines[-1]
    assert "row 2" in lines[-1]

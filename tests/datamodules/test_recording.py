"""Folders as people have them, read on this machine."""

import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from datamodules.formats.udacity import times_from_names
from datamodules.recording import read_recordings
from tests.recordings import FOLDERS, write_recording
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


def test_labels_are_those_written(recorded):
    recording = read_recordings(str(recorded.folder))
    np.testing.assert_array_equal(recording.steering, recorded.steering)
    np.testing.assert_array_equal(recording.throttle, recorded.throttle)
    np.testing.assert_array_equal(recording.brake, recorded.brake)
    np.testing.assert_array_equal(recording.speed_mph, recorded.speed_mph)


def test_labels_with_decimal_commas_are_those_written(tmp_path):
    written = write_recording(tmp_path / "lake", rows=90, decimal_comma=True)
    assert len(written.log.read_text().splitlines()[1].split(",")) > 7
    recording = read_recordings(str(written.folder))
    np.testing.assert_array_equal(recording.steering, written.steering)
    np.testing.assert_array_equal(recording.brake, written.brake)
    np.testing.assert_array_equal(recording.speed_mph, written.speed_mph)


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


def test_centre_only_by_empty_columns(tmp_path):
    written = write_recording(tmp_path / "lake", rows=2, cameras=("center",))
    recording = read_recordings(str(written.folder))
    assert recording.images[:, 1:].tolist() == [[None, None]] * 2
    np.testing.assert_array_equal(recording.steering, written.steering)


def test_centre_only_by_a_header_of_five_columns(tmp_path):
    written = write_recording(tmp_path / "lake", rows=2, cameras=("center",))
    rows = [line.replace(",,,", ",") for line in written.log.read_text().splitlines()]
    written.log.write_text("\n".join(["center,steering,throttle,brake,speed", *rows]))
    recording = read_recordings(str(written.folder))
    assert recording.images[:, 1:].tolist() == [[None, None]] * 2
    np.testing.assert_array_equal(recording.speed_mph, written.speed_mph)


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


def test_lower_case_img(tmp_path):
    written = write_recording(tmp_path / "lake", rows=2)
    (written.folder / "IMG").rename(written.folder / "img")
    recording = read_recordings(str(written.folder))
    assert Path(recording.images[0, 0]).parent.name == "img"


def test_images_beside_the_log(tmp_path):
    written = write_recording(tmp_path / "lake", rows=2)
    for image in written.folder.glob("IMG/*.jpg"):
        image.rename(written.folder / image.name)
    recording = read_recordings(str(written.folder))
    assert Path(recording.images[0, 0]).parent == written.folder


def test_images_in_a_folder_per_lap(tmp_path):
    written = write_recording(tmp_path / "lake", rows=2, style="windows")
    (written.folder / "lap 1").mkdir()
    (written.folder / "IMG").rename(written.folder / "lap 1" / "IMG")
    log = written.log.read_text().replace("\\IMG\\", "\\lap 1\\IMG\\")
    written.log.write_text(log)
    recording = read_recordings(str(written.folder))
    assert Path(recording.images[0, 0]).parent == written.folder / "lap 1" / "IMG"


def test_images_where_the_log_says_on_the_machine_that_recorded_it(tmp_path):
    written = write_recording(tmp_path / "lake", rows=2, style="linux")
    there = (written.folder / "IMG").rename(tmp_path / "there")
    written.log.write_text(written.log.read_text().replace(FOLDERS["linux"], f"{there}/"))
    recording = read_recordings(str(written.folder))
    assert Path(recording.images[0, 0]).parent == there


def test_missing_folder(tmp_path):
    assert f"{tmp_path}/nowhere: no such folder" in refusal(str(tmp_path / "nowhere"))


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


def test_bad_row_names_its_file(tmp_path):
    written = write_recording(tmp_path / "lake", rows=3)
    edit_log(written.folder, f"{written.speed_mph[1]:.7G}\n", "NaN\n")
    assert f"{written.log}, row 2: speed is 'NaN'" in refusal(str(written.folder))


def test_missing_image_names_file_row_and_image(tmp_path):
    written = write_recording(tmp_path / "lake", rows=4)
    written.image(2, "left").unlink()
    message = refusal(str(written.folder))
    assert f"{written.log}, row 3: no image left_{written.stems[2]}.jpg" in message
    assert "(1 of 4 rows" in message


def test_missing_image_may_be_skipped(tmp_path):
    written = write_recording(tmp_path / "lake", rows=4)
    written.image(2, "left").unlink()
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


def test_fingerprint_stays_when_the_folder_moves(tmp_path):
    written = write_recording(tmp_path / "lake", rows=5)
    before = read_recordings(str(written.folder)).fingerprint()
    moved = written.folder.rename(tmp_path / "moved")
    assert read_recordings(str(moved)).fingerprint() == before


def test_fingerprint_stays_when_the_log_names_another_machine(tmp_path):
    one = write_recording(tmp_path / "one", rows=5, style="windows")
    two = write_recording(tmp_path / "two", rows=5, style="linux")
    fingerprints = {read_recordings(str(each.folder)).fingerprint() for each in (one, two)}
    assert len(fingerprints) == 1


@pytest.mark.parametrize("column", ["steering", "speed_mph"])
def test_fingerprint_changes_with_a_label(tmp_path, column):
    written = write_recording(tmp_path / "lake", rows=5)
    before = read_recordings(str(written.folder)).fingerprint()
    edit_log(written.folder, f"{getattr(written, column)[3]:.7G}", "0.987")
    assert read_recordings(str(written.folder)).fingerprint() != before


def test_fingerprint_changes_when_a_row_goes(tmp_path):
    written = write_recording(tmp_path / "lake", rows=5)
    recording = read_recordings(str(written.folder))
    assert recording.keep(np.arange(5) != 2).fingerprint() != recording.fingerprint()


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

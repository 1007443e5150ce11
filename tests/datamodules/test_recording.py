"""Folders as people have them, read on this machine."""

import os
import shutil
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from datamodules.formats.udacity import times_from_names
from datamodules.image import ForwardReader
from datamodules.recording_format import read_recordings
from tests.recordings import FOLDERS, replace_in, write_recording
from tests.refusals import refusal


@pytest.mark.parametrize("header", [False, True], ids=["bare", "header"])
@pytest.mark.parametrize("style", FOLDERS)
def test_images_are_found_here_wherever_the_log_was_made(tmp_path, style, header):
    written = write_recording(tmp_path / "lake", rows=3, style=style, header=header)
    recording = read_recordings(str(written.folder))
    for row in range(3):
        for camera, name in enumerate(("center", "left", "right")):
            assert written.image(row, name).samefile(recording.images[row, camera])


def test_threads_that_read_a_file_at_once_each_get_their_images():
    def numbers(path):
        for number in range(400):
            time.sleep(1e-5)  # another thread's turn
            yield number

    reader = ForwardReader(numbers)
    with ThreadPoolExecutor(2) as pool:
        walks = pool.map(lambda row: [reader("video", at) for at in range(row, 400, 2)], (0, 1))
        assert [*walks] == [[*range(row, 400, 2)] for row in (0, 1)]


def test_a_fingerprint_holds_no_digits_that_processors_compute_differently(tmp_path):
    recording = read_recordings(str(write_recording(tmp_path / "lake", rows=9).folder))
    others = (replace(recording, steering=recording.steering + change) for change in (-2e-16, 1e-4))
    assert [changed.fingerprint() == recording.fingerprint() for changed in others] == [True, False]


def test_rows_are_recognised_in_a_part_of_another_recording(tmp_path):
    recording = read_recordings(str(write_recording(tmp_path / "lake", rows=90).folder))
    part = recording.keep(np.arange(90) % 3 > 0)
    part = replace(part, steering=np.where(np.arange(60) < 15, 0.123, part.steering))
    hashes = set(recording.row_hashes())
    assert (len(hashes), len(hashes & set(part.row_hashes()))) == (90, 45)


@pytest.mark.parametrize("name", ["my lake", "lr=0.1,x", "[lake] {1}", "Straße %20 'n'"])
def test_a_folder_or_log_with_an_awkward_name(tmp_path, name):
    written = write_recording(tmp_path / name, rows=2)
    recording = read_recordings(str(written.folder))
    assert len(read_recordings(str(written.log))) == 2
    assert Path(recording.images[1, 2]).read_bytes() == written.image(1, "right").read_bytes()


def test_a_path_out_of_the_folder_is_not_followed(tmp_path):
    image = write_recording(tmp_path / "other", rows=1).image(0)
    (tmp_path / "lake").mkdir()
    (tmp_path / "lake/driving_log.csv").write_text(f"../other/IMG/{image.name},,,0,0,0,9\n")
    assert "row 1: no image" in refusal(read_recordings, str(tmp_path / "lake"))


def test_several_folders_keep_which_is_which(tmp_path):
    first = write_recording(tmp_path / "first", rows=2, seed=1)
    second = write_recording(tmp_path / "second", rows=3, seed=2)  # the same file names
    recording = read_recordings([str(first.folder), str(second.folder)])
    assert recording.recording.tolist() == [0, 0, 1, 1, 1]
    assert recording.names == (str(first.folder), str(second.folder))
    np.testing.assert_array_equal(recording.speed_mph[2:], second.speed_mph)
    assert Path(recording.images[0, 0]).read_bytes() == first.image(0).read_bytes()
    assert Path(recording.images[2, 0]).read_bytes() == second.image(0).read_bytes()
    assert recording.place(3) == f"{second.folder}/driving_log.csv, row 2"


@pytest.mark.parametrize("cameras", [("center",), ("center", "left", "right")])
def test_a_recording_without_side_images_has_a_centre_camera_alone(tmp_path, cameras):
    written = write_recording(tmp_path / "lake", rows=2, cameras=cameras)
    for image in written.folder.glob("IMG/[lr]*.jpg"):
        image.unlink()
    assert read_recordings(str(written.folder)).images[:, 1:].tolist() == [[None, None]] * 2


def beside_the_log(folder: Path) -> Path:
    for image in folder.glob("IMG/*.jpg"):
        image.rename(folder / image.name)
    return folder


def in_a_folder_per_lap(folder: Path) -> Path:
    (folder / "lap 1").mkdir()
    replace_in(folder / "driving_log.csv", "\\IMG\\", "\\lap 1\\IMG\\")
    return (folder / "IMG").rename(folder / "lap 1" / "IMG")


def where_the_log_says(folder: Path) -> Path:
    """Move the images to the place that the log of this machine names."""
    there = (folder / "IMG").rename(folder.parent / "there")
    replace_in(folder / "driving_log.csv", FOLDERS["linux"], f"{there}/")
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


def test_of_two_spellings_of_the_folder_the_first_by_name_counts(tmp_path, monkeypatch):
    written, listed = write_recording(tmp_path / "lake", rows=2), Path.iterdir
    replace_in(written.log, FOLDERS["windows"], "")
    (written.folder / "img").mkdir(exist_ok=True)
    (written.folder / "img" / written.image(0).name).write_bytes(b"another image")
    monkeypatch.setattr(Path, "iterdir", lambda path: sorted(listed(path), reverse=True))
    assert Path(read_recordings(str(written.folder)).images[0, 0]).parent.name == "IMG"


def recorded_here(folder: Path, rows: int = 4):
    """Write a recording whose log has the absolute paths of this machine."""
    written = write_recording(folder, rows=rows, style="linux")
    replace_in(folder / "driving_log.csv", FOLDERS["linux"], f"{folder}/IMG/")
    return written


def test_a_copy_of_the_log_alone_reads_the_originals_images_and_says_so(tmp_path):
    (tmp_path / "clean").mkdir()
    shutil.copy(recorded_here(tmp_path / "lake").log, tmp_path / "clean")
    recording = read_recordings(str(tmp_path / "clean"))
    assert Path(recording.images[0, 0]).parent == tmp_path / "lake/IMG"
    (note,) = recording.notes
    assert f"the images of 4 rows are read from {tmp_path}/lake/IMG," in note


def test_an_image_that_was_cleaned_out_of_a_copy_is_not_read_from_the_original(tmp_path):
    written = recorded_here(tmp_path / "lake")
    shutil.copytree(written.folder, tmp_path / "clean")
    (tmp_path / "clean/IMG" / written.image(2).name).unlink()
    message = refusal(read_recordings, str(tmp_path / "clean"))
    assert f"row 3: no image {written.image(2).name} in {tmp_path}/clean/IMG" in message
    recording = read_recordings(str(tmp_path / "clean"), on_bad_image="skip")
    assert recording.line.tolist() == [1, 2, 4]
    assert all(str(path).startswith(f"{tmp_path}/clean/") for path in recording.images.flat)


def test_two_logs_joined_read_the_images_of_both(tmp_path):
    first, second = recorded_here(tmp_path / "one"), recorded_here(tmp_path / "two")
    for image in second.folder.glob("IMG/*"):
        image.rename(image.with_name(image.name.replace("_2018_", "_2019_")))
    with first.log.open("a") as log:
        log.write(second.log.read_text().replace("_2018_", "_2019_"))
    recording = read_recordings(str(first.folder))
    parents = [Path(path).parents[1].name for path in recording.images[:, 0]]
    assert parents == ["one"] * 4 + ["two"] * 4
    assert f"the images of 4 rows are read from {tmp_path}/two/IMG," in recording.notes[0]


def unname(image: Path) -> None:
    replace_in(image.parents[1] / "driving_log.csv", f"{FOLDERS['windows']}{image.name}", "")


@pytest.mark.parametrize(
    ("camera", "replace_image", "words"),
    [
        ("left", lambda image: None, "no image {}"),
        ("center", os.mkfifo, "no image {}"),
        ("center", lambda image: image.symlink_to("/dev/zero"), "no image {}"),
        ("center", Path.mkdir, "no image {}"),
        ("center", unname, "names no centre image"),
    ],
    ids=["no file", "pipe", "device", "folder", "no name"],
)
def test_a_missing_image_is_named_or_skipped(tmp_path, camera, replace_image, words):
    written = write_recording(tmp_path / "lake", rows=4)
    image = written.image(2, camera)
    folder = str(written.folder)
    image.unlink()
    replace_image(image)
    message = f"{written.log}, row 3: {words.format(image.name)}"
    assert f"{message} in {folder}/IMG (1 of 4 rows" in refusal(read_recordings, folder)
    recording = read_recordings(folder, on_bad_image="skip")
    assert recording.line.tolist() == [1, 2, 4]
    np.testing.assert_array_equal(recording.steering, np.delete(written.steering, 2))
    assert recording.bad_images == (message,)


def test_an_image_may_be_a_link(tmp_path):
    written = write_recording(tmp_path / "lake", rows=2)
    written.image(1).symlink_to(written.image(1).rename(tmp_path / "elsewhere.jpg"))
    assert len(read_recordings(str(written.folder))) == 2


def test_a_missing_folder_of_several_or_of_images_is_named(tmp_path):
    lake, nowhere = str(write_recording(tmp_path / "lake", rows=2).folder), f"{tmp_path}/nowhere"
    for root, images in (([lake, nowhere], None), (lake, nowhere)):
        message = refusal(read_recordings, root, images=images)
        assert message.startswith(f"{nowhere}: no such folder")


def test_empty_list_of_folders():
    assert "data.root is an empty list" in refusal(read_recordings, [])


@pytest.mark.parametrize("on_bad_image", ["fail", "skip"])
def test_all_images_missing(tmp_path, on_bad_image):
    written = write_recording(tmp_path / "lake", rows=3)
    shutil.rmtree(written.folder / "IMG")
    message = refusal(read_recordings, str(written.folder), on_bad_image=on_bad_image)
    assert "row 1" in message
    assert "center_" in message


def test_a_fingerprint_is_that_of_labels_and_names_wherever_the_folder_is(tmp_path):
    first = write_recording(tmp_path / "one", rows=5, style="windows")
    second = write_recording(tmp_path / "two", rows=5, style="linux")
    recording = read_recordings(str(first.folder))
    before = recording.fingerprint()
    assert read_recordings(str(second.folder)).fingerprint() == before, "the log of another machine"
    assert recording.keep(np.arange(5) != 2).fingerprint() != before
    moved = first.folder.rename(tmp_path / "moved")
    log = moved / "driving_log.csv"
    assert read_recordings(str(moved)).fingerprint() == before
    for column in ("steering", "speed_mph"):
        number = f",{getattr(first, column)[3]:.7G}"
        replace_in(log, number, ",0.987")
        assert read_recordings(str(moved)).fingerprint() != before
        replace_in(log, ",0.987", number)


def test_times_are_those_in_the_file_names(recorded):
    recording = read_recordings(str(recorded.folder))
    np.testing.assert_allclose(recording.time_s, recorded.time_s, atol=1e-3)
    impossible = ["center_2018_13_01_00_00_00_000.jpg", "center_2018_02_30_24_00_00_000.jpg"]
    names = ["IMG/center_1970_01_02_00_00_01_250.jpg", "center_5.jpg", *impossible]
    np.testing.assert_array_equal(times_from_names(names), [86401.25, *[np.nan] * 3])

"""Recordings in the original's format, readable also after a crash or on a full disk."""

import os
import resource
import signal
import sys

import cv2
import numpy as np
import pytest

from datamodules.recording_format import read_recordings
from tests.without_rights import without_rights
from tests.zoo.command_runs import run_words
from zoo.base.errors import InputError
from zoo.simulator.recorder import Recorder, split_pedals
from zoo.simulator.udacity_car import CAMERAS

FRAMES = {
    name: np.full((160, 320, 3), (200, 40 * i, 0), np.uint8) for i, name in enumerate(CAMERAS)
}


def add_rows(recorder: Recorder, count: int, begin_s: float = 0.0) -> None:
    for row in range(count):
        recorder.add(FRAMES, -0.1 * (row % 3), 1, 0, 30.19028, begin_s + row / 15)


def test_it_writes_what_the_original_writes(tmp_path):
    with Recorder(tmp_path / "lake") as recorder:
        recorder.add(FRAMES, -0.123456789, 1.0, 0.0, 30.190283, 0.0)
        recorder.add(FRAMES, 0.0, 0.0, 0.85786134, 1e-6, 0.066)
    images = tmp_path / "lake" / "IMG"
    paths = [f"{images}/{name}_2020_01_01_12_00_00_000.jpg" for name in CAMERAS]
    first, second = (tmp_path / "lake" / "driving_log.csv").read_bytes().splitlines(keepends=True)
    assert first.decode() == ",".join(paths) + ",-0.1234568,1,0,30.19028\n"
    assert second.decode().endswith("_066.jpg,0,0,0.8578613,1E-06\n")
    assert sorted(path.name for path in images.iterdir())[0] == paths[0].split("/")[-1]


def test_its_images_are_like_the_originals(tmp_path):
    with Recorder(tmp_path) as recorder:
        add_rows(recorder, 1)
    for camera in CAMERAS:
        (path,) = (tmp_path / "IMG").glob(f"{camera}_*.jpg")
        image = cv2.imread(str(path))[..., ::-1]
        assert image.shape == (160, 320, 3)
        assert np.abs(image.astype(int) - FRAMES[camera]).max() <= 4
        # The begin of the first quantisation table of quality 75.
        assert b"\xff\xdb\x00\x43\x00\x08\x06\x06" in path.read_bytes()


NOT_UTF_8 = pytest.param(
    os.fsdecode(b"sch\xf6n"),
    marks=pytest.mark.skipif(sys.platform != "linux", reason="names are UTF-8 here"),
)


@pytest.mark.parametrize("header", [False, True])
@pytest.mark.parametrize("relative", [False, True])
@pytest.mark.parametrize("name", ["lake", "a lake, mine", NOT_UTF_8])
def test_our_reader_reads_it(tmp_path, name, header, relative):
    with Recorder(tmp_path / name, header=header, relative=relative) as recorder:
        add_rows(recorder, 20)
    recording = read_recordings(str(tmp_path / name))
    assert len(recording) == 20
    assert recording.steering[:4] == pytest.approx([0, -0.1, -0.2, 0])
    assert recording.throttle.all()
    assert not recording.brake.any()
    assert recording.speed_mph == pytest.approx(30.19028)
    assert np.diff(recording.time_s) == pytest.approx(1 / 15, abs=0.001)


def test_relative_and_header_are_as_in_the_courses_sample_data(tmp_path):
    with Recorder(tmp_path, header=True, relative=True) as recorder:
        add_rows(recorder, 1)
    header, row = (tmp_path / "driving_log.csv").read_text().splitlines()
    assert header == "center,left,right,steering,throttle,brake,speed"
    stamp = "2020_01_01_12_00_00_000.jpg"
    assert row.startswith(f"IMG/center_{stamp}, IMG/left_{stamp}, IMG/right_{stamp},0,1,0,")


def test_a_row_that_is_no_later_is_refused_and_overwrites_nothing(tmp_path):
    with Recorder(tmp_path) as recorder:
        recorder.add(FRAMES, 0, 0, 0, 0, 1.0)
        with pytest.raises(ValueError, match="begin_pass"):
            recorder.add(FRAMES, 0, 0, 0, 0, 1.0003)


KILLED = """
import os, signal, sys
from tests.zoo.simulator.test_recorder import Recorder, add_rows
recorder = Recorder(sys.argv[1])
add_rows(recorder, 7)
(recorder.images / "center_2020_01_01_12_00_09_000.jpg").write_bytes(b"half of the next")
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_killed_recorder_leaves_every_row_it_was_given(tmp_path):
    done = run_words(tmp_path, sys.executable, "-c", KILLED, str(tmp_path))
    assert done.returncode == -signal.SIGKILL
    assert len(read_recordings(str(tmp_path))) == 7


def test_a_folder_with_a_recording_is_refused_and_left_as_it_is(tmp_path):
    with Recorder(tmp_path) as recorder:
        add_rows(recorder, 2)
    with pytest.raises(InputError) as error:
        Recorder(tmp_path)
    assert str(tmp_path) in str(error.value)
    assert "out=" in str(error.value)
    assert len(read_recordings(str(tmp_path))) == 2


def test_a_path_that_is_a_file_is_refused(tmp_path):
    (tmp_path / "file").write_text("mine")
    for path in (tmp_path / "file", tmp_path / "file" / "lake"):
        with pytest.raises(InputError, match=r"file.*: cannot be written to"):
            Recorder(path)


def test_a_folder_without_permission_is_refused(tmp_path):
    tmp_path.chmod(0o500)
    with without_rights(), pytest.raises(InputError, match="record there: Permission denied"):
        Recorder(tmp_path / "lake")
    tmp_path.chmod(0o700)


@pytest.mark.parametrize("room", [1000, 2500], ids=["images", "log"])
def test_a_full_disk_is_one_line_and_the_rows_before_can_be_used(tmp_path, room):
    """A limit on file size stands for a full disk: at a row's images, or within a log line."""
    recorder = Recorder(tmp_path)
    add_rows(recorder, 3)
    usual = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, usual[1]))
    try:
        with pytest.raises(InputError) as error, recorder:
            add_rows(recorder, 50, begin_s=1.0)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, usual)
    rows = recorder.rows
    assert rows == 3 if room == 1000 else rows > 3
    assert f"{tmp_path}: File too large after {rows} rows, which are kept" in str(error.value)
    assert len(read_recordings(str(tmp_path))) == rows
    assert len(list((tmp_path / "IMG").iterdir())) == 3 * rows
    assert recorder.log.read_bytes().endswith(b"\n")


def test_a_recorder_without_rows_leaves_nothing(tmp_path):
    with Recorder(tmp_path / "lake", header=True):
        pass
    assert not (tmp_path / "lake").exists()


def test_a_command_is_either_throttle_or_brake():
    assert split_pedals(0.4) == (0.4, 0)
    assert split_pedals(-0.4) == (0, 0.4)

"""Rows worth a look: where the sharpest bends, jumps, standstills and odd frames are."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from datamodules.notable_rows import (
    frame_difference,
    largest_errors,
    odd_frames,
    sharpest_bends,
    standstills,
    steering_jumps,
    thumbnail,
)
from tests.recordings import Written, recording_in_memory

ROWS = 600


def test_the_sharpest_bend_comes_first_and_each_bend_once() -> None:
    steering = np.zeros(ROWS)
    steering[100:130], steering[300:330], steering[500] = 0.2, -0.6, 1.0
    bends = sharpest_bends(recording_in_memory(steering))
    assert [300 <= bends[0].row < 330, 100 <= bends[1].row < 130] == [True, True]
    assert [round(one.value, 6) for one in bends[:2]] == [-0.6, 0.2]
    assert len([one for one in bends if 290 < one.row < 340]) == 1


def test_a_jump_is_between_two_rows_that_follow_each_other() -> None:
    steering = np.zeros(ROWS)
    steering[200:], steering[400:] = 0.5, -0.4
    recording = recording_in_memory(steering)
    assert [one.row for one in steering_jumps(recording)] == [400, 200]
    time_s = recording.time_s + np.where(np.arange(ROWS) < 400, 0, 60)
    assert [one.row for one in steering_jumps(replace(recording, time_s=time_s))] == [200]


def test_standstills_are_listed_by_length() -> None:
    speed = np.full(ROWS, 20.0)
    speed[:3], speed[50:60] = 0, 0.5
    found = standstills(recording_in_memory(np.zeros(ROWS), speed))
    assert [(one.row, one.value) for one in found] == [(50, 10), (0, 3)]


def test_an_odd_frame_differs_from_both_neighbours() -> None:
    differences = np.full(ROWS, 5.0)
    differences[0] = np.nan
    differences[100:102] = 60  # one foreign frame
    differences[300] = 60  # another scene begins
    differences[400:460] = 40  # a bend
    differences[500], differences[501] = np.inf, np.nan
    found = odd_frames(recording_in_memory(np.zeros(ROWS)), differences)
    assert [one.row for one in found] == [500, 100]
    assert found[1].value == pytest.approx(12)


def test_the_largest_error_comes_first() -> None:
    predicted = np.full(ROWS, np.nan)
    predicted[:300], predicted[50], predicted[200] = 0.01, 0.3, -0.5
    found = largest_errors(recording_in_memory(np.zeros(ROWS)), predicted)
    assert [(one.row, one.value) for one in found] == [(200, -0.5), (50, 0.3)]


def test_thumbnails_of_neighbours_are_alike(recorded: Written) -> None:
    one, next_one, far = (thumbnail(str(recorded.image(row))) for row in (10, 11, 60))
    assert one.shape == (20, 40)
    assert 0 < frame_difference(one, next_one) < frame_difference(one, far)


def test_what_is_no_image_has_no_thumbnail(tmp_path, recorded: Written) -> None:
    data = recorded.image(1).read_bytes()
    for name, contents in (("text.jpg", b"no image"), ("half.jpg", data[: len(data) // 2])):
        (tmp_path / name).write_bytes(contents)
        with pytest.raises(ValueError, match=r"no JPEG|truncated"):
            thumbnail(str(tmp_path / name))
    png = cv2.imencode(".png", np.zeros((8, 8, 3), np.uint8))[1].tobytes()
    (tmp_path / "small.png").write_bytes(png)
    assert thumbnail(str(tmp_path / "small.png")).shape == (20, 40)

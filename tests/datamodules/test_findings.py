"""What is odd about a recording, its figures, and rows worth a look."""

import re
import shutil
from dataclasses import replace

import cv2
import numpy as np
import pytest

from datamodules.looking.findings import FEW_ROWS, find_oddities, report_lines, report_recordings
from datamodules.looking.notable_rows import (
    frame_difference,
    largest_errors,
    odd_frames,
    sharpest_bends,
    standstills,
    steering_jumps,
    thumbnail,
)
from datamodules.recording import Recording
from datamodules.recording_format import read_recordings
from tests.recordings import Written, recording_in_memory, write_recording
from zoo.simulator.record import RecordOptions, record_laps

RNG = np.random.default_rng(0)
SMOOTH = np.sin(np.arange(2_000) / 40) * 0.3 + RNG.normal(0, 1e-3, 2_000)


def texts(recording: Recording) -> dict[str, str]:
    """Return each finding's text by its kind; check that it is one line."""
    found = find_oddities(recording)
    assert all("\n" not in one.text for one in found)
    assert len({one.kind for one in found}) == len(found)
    return {one.kind: one.text for one in found}


def with_pauses(recording: Recording, rows: range) -> Recording:
    """Return the recording with a pause of ten seconds before each of `rows`."""
    paused = np.isin(np.arange(len(recording)), rows)
    return replace(recording, time_s=recording.time_s + 10 * np.cumsum(paused))


def recoveries(count: int) -> Recording:
    """Return 2,000 rows in the middle of the road, with a number of recoveries after pauses."""
    steering, starts = RNG.normal(0, 1e-3, 2_000), range(100, 100 + 200 * count, 200)
    for start in starts:
        steering[start : start + 15] -= np.linspace(0.4, 0, 15)
    return with_pauses(recording_in_memory(steering), starts)


def test_a_keyboard_is_named_with_its_figures_and_a_remedy():
    taps = np.repeat(RNG.choice([-0.5, -0.25, 0.25, 0.5], 100), 20) * (np.arange(2_000) % 20 < 6)
    text = texts(recording_in_memory(taps))["keyboard"]
    assert "70%" in text
    assert "600 rows share 4 values" in text
    assert "drivezoo simulator drive" in text


def test_steering_that_is_always_0_is_no_keyboards():
    text = texts(recording_in_memory(np.zeros(2_000)))["keyboard"]
    assert text.startswith("the steering is 0 in each row")
    assert "data.steering" in text
    assert "keyboard" not in text


def test_a_wheel_that_is_let_go_of_is_no_keyboard():
    """Half of the steering is 0, but no other value occurs twice."""
    steering = np.where(np.arange(2_000) % 40 < 20, 0, SMOOTH)
    assert "keyboard" not in texts(recording_in_memory(steering))


def test_no_way_back_to_the_middle_is_named_with_how_to_record_one():
    text = texts(recording_in_memory(SMOOTH))["no_recoveries"]
    assert text.startswith("0 stretches")
    assert "data.offset" in text
    assert "noise=1" in text


def test_ways_back_after_pauses_are_recoveries():
    assert "no_recoveries" not in texts(recoveries(4))


def test_one_way_back_in_a_long_recording_is_too_few():
    assert texts(recoveries(1))["no_recoveries"].startswith("1 stretch")


def test_pauses_alone_are_no_recoveries():
    straight = recording_in_memory(RNG.normal(0, 1e-3, 2_000))
    assert "no_recoveries" in texts(with_pauses(straight, range(100, 900, 100)))


def test_without_times_recoveries_cannot_be_told():
    recording = recording_in_memory(SMOOTH)
    recording = replace(recording, time_s=np.full(2_000, np.nan))
    assert "no_recoveries" not in texts(recording)


def test_two_speeds_are_named_with_a_key():
    speeds = np.where(np.arange(2_000) < 800, 15, 30)
    text = texts(recording_in_memory(SMOOTH, speeds))["two_speeds"]
    assert "60% of rows are driven at about 30 mph, 40% at about 15" in text
    assert "data.recover_s" in text


def test_a_missing_speed_is_named_with_its_recording_and_a_key():
    text = texts(recording_in_memory(SMOOTH, np.zeros(2_000)))["no_speed"]
    assert "0 mph in each row of" in text
    assert "speed=" in text
    assert "no_speed" not in texts(recording_in_memory(SMOOTH))


def test_an_unknown_rig_is_named_in_place_of_a_replay_that_would_stop():
    unknown = replace(recording_in_memory(SMOOTH, np.zeros(2_000)), rig=None)
    found = texts(unknown)
    assert "drivezoo new rig" in found["no_rig"]
    assert "data.rig=donkey_sim" in found["no_rig"]
    assert not any("drivezoo replay" in text for text in found.values())
    assert "no_rig" not in texts(recording_in_memory(SMOOTH))


def test_a_remedy_for_side_cameras_is_not_offered_without_them_or_their_places():
    speeds = np.where(np.arange(2_000) < 800, 15, 30)
    with_sides = recording_in_memory(SMOOTH, speeds)
    assert "data.recover_s" not in texts(replace(with_sides, rig=None))["two_speeds"]
    centre = replace(with_sides, images=np.where([True, False, False], with_sides.images, None))
    assert "two_speeds" not in texts(centre)


@pytest.mark.parametrize(
    "speeds",
    [
        np.full(2_000, 30.0),
        np.linspace(0, 30, 2_000),
        np.minimum(np.linspace(0, 100, 2_000), 30),
        np.zeros(2_000),
        np.where(np.arange(2_000) < 1_000, 25.0, 29.0),
    ],
    ids=["one", "spread", "gains speed", "stands", "near"],
)
def test_one_speed_or_many_are_not_two(speeds):
    assert "two_speeds" not in texts(recording_in_memory(SMOOTH, speeds))


def test_an_image_that_several_rows_name_is_a_duplicate():
    recording = recording_in_memory(SMOOTH)
    images = recording.images.copy()
    images[7] = images[6]
    text = texts(replace(recording, images=images))["duplicates"]
    assert text.startswith("3 of 6,000 images")
    assert "delete" in text


def test_an_image_that_repeats_the_row_befores_is_a_duplicate(tmp_path):
    written = write_recording(tmp_path / "lake", rows=6)
    for row in range(1, 6):
        shutil.copy(written.image(0), written.image(row))
    assert texts(read_recordings(str(written.folder)))["duplicates"].startswith("5 of 6 ")


def test_a_car_that_stands_still_is_no_duplicate(tmp_path):
    written = write_recording(tmp_path / "lake", rows=6)
    shutil.copy(written.image(2), written.image(3))
    recording = read_recordings(str(written.folder))
    assert "duplicates" not in texts(replace(recording, speed_mph=np.zeros(6)))


def test_a_recording_of_the_centre_camera_alone_is_named_with_an_augmentation():
    recording = recording_in_memory(SMOOTH, cameras=("center",))
    assert "augment=[shift]" in texts(recording)["centre_only"]


def test_few_rows_are_named_with_their_number_and_a_key():
    assert "centre_only" not in texts(recording_in_memory(SMOOTH))
    text = texts(recording_in_memory(SMOOTH[: FEW_ROWS - 1]))["few_rows"]
    assert f"{FEW_ROWS - 1}" in text
    assert "quick=true" in text
    assert "few_rows" not in texts(recording_in_memory(SMOOTH[:FEW_ROWS]))


@pytest.mark.parametrize(("sign", "side"), [(1, "right"), (-1, "left")])
def test_steering_to_one_side_is_named_with_the_side_and_a_key(sign, side):
    text = texts(recording_in_memory(sign * (SMOOTH + 0.2)))["one_direction"]
    assert f"to the {side}" in text
    assert "data.flip" in text
    assert "one_direction" not in texts(recording_in_memory(SMOOTH))


@pytest.mark.slow
@pytest.mark.parametrize(("noise", "missing"), [(0.0, True), (1.0, False)])
def test_the_experts_recordings_lack_recoveries_without_noise_alone(tmp_path, noise, missing):
    options = RecordOptions(
        track="lake", out=str(tmp_path / "lake"), laps=0.25, noise=noise, seed=1, quality="simple"
    )
    found = texts(read_recordings(str(record_laps(options))))
    assert ("no_recoveries" in found) == missing
    assert "keyboard" not in found
    assert "two_speeds" not in found
    assert "duplicates" not in found


def test_one_tap_among_zeros_has_no_side():
    steering = np.zeros(2_000)
    steering[700:705] = -0.4
    assert "one_direction" not in texts(recording_in_memory(steering))


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


def test_a_pause_is_a_gap_and_no_driving(tmp_path):
    written = write_recording(tmp_path / "lake", rows=30)
    rename_time(written, 29, "2018_07_16_18_00_00_000")
    (report,) = report_recordings(read_recordings(str(written.folder)))
    assert report.gaps == 1
    assert report.seconds == pytest.approx(28 / 15, abs=0.01)


def test_a_step_back_in_time_is_a_gap(tmp_path):
    written = write_recording(tmp_path / "lake", rows=30)
    rename_time(written, 29, "2018_07_16_17_00_00_000")
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

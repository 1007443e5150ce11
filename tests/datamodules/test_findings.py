"""What is odd about a recording, its figures, and rows worth a look."""

import re
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from datamodules.edited_recording import write_edited
from datamodules.looking import notable_rows as notable
from datamodules.looking.findings import FEW_ROWS, find_oddities, report_lines, report_recordings
from datamodules.recording import Recording
from datamodules.recording_edits import Edits, drop
from datamodules.recording_format import read_recordings
from tests.recordings import Written, recording_in_memory, write_recording
from zoo.simulator.record import RecordOptions, record_laps

RNG = np.random.default_rng(0)
SMOOTH = np.sin(np.arange(2_000) / 40) * 0.3 + RNG.normal(0, 1e-3, 2_000)


def texts(recording: Recording) -> dict[str, str]:
    """Return each finding's text by its kind; check that it is one line."""
    oddities = find_oddities(recording)
    assert all("\n" not in oddity.text for oddity in oddities)
    assert len({oddity.kind for oddity in oddities}) == len(oddities)
    return {oddity.kind: oddity.text for oddity in oddities}


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


TAPS = np.repeat(RNG.choice([-0.5, -0.25, 0.25, 0.5], 100), 20) * (np.arange(2_000) % 20 < 6)
TAP = np.where(np.arange(2_000) // 5 == 140, -0.4, 0)
LET_GO = np.where(np.arange(2_000) % 40 < 20, 0, SMOOTH)  # but for 0, no value occurs twice
TWO_SPEEDS = np.where(np.arange(2_000) < 800, 15, 30)
PAUSES = with_pauses(recording_in_memory(RNG.normal(0, 1e-3, 2_000)), range(100, 900, 100))
# Of a recording, or of its steering: the words of a finding, in their order.
ODDITIES = [
    ("keyboard", TAPS, "^70%.*600 rows share 4 values.*drivezoo simulator drive"),
    ("keyboard", 0 * SMOOTH, r"^the steering is 0 in each row(?!.*keyboard).*data\.steering"),
    ("no_recoveries", SMOOTH, r"^0 stretches.*data\.offset.*noise=1 out=FOLDER"),
    ("no_recoveries", recoveries(1), "^1 stretch"),
    ("no_recoveries", PAUSES, "^0 stretches"),
    (
        "two_speeds",
        recording_in_memory(SMOOTH, TWO_SPEEDS),
        r"^60% of rows are driven at about 30 mph, 40% at about 15.*data\.recover_s",
    ),
    ("no_speed", recording_in_memory(SMOOTH, 0 * SMOOTH), "^the speed of .* is unknown.*speed="),
    ("centre_only", recording_in_memory(SMOOTH, cameras=("center",)), r"augment=\[shift\]"),
    ("few_rows", SMOOTH[: FEW_ROWS - 1], rf"\b{FEW_ROWS - 1} rows.*quick=true"),
    ("one_direction", SMOOTH + 0.2, r"to the right.*data\.flip"),
    ("one_direction", -SMOOTH - 0.2, r"to the left.*data\.flip"),
]


def driven(recording: Recording | np.ndarray) -> Recording:
    return recording if isinstance(recording, Recording) else recording_in_memory(recording)


@pytest.mark.parametrize(("kind", "recording", "words"), ODDITIES)
def test_an_oddity_is_named_with_its_figures_and_a_remedy(kind, recording, words):
    assert re.search(words, texts(driven(recording))[kind])


@pytest.mark.parametrize(
    ("kind", "recording"),
    [
        ("keyboard", LET_GO),
        ("no_recoveries", recoveries(4)),
        ("no_recoveries", replace(driven(SMOOTH), time_s=np.full(2_000, np.nan))),
        ("few_rows", SMOOTH[:FEW_ROWS]),
        ("one_direction", TAP),
        ("two_speeds", recording_in_memory(SMOOTH, 30.0)),
        ("two_speeds", recording_in_memory(SMOOTH, np.linspace(0, 30, 2_000))),
        ("two_speeds", recording_in_memory(SMOOTH, np.minimum(np.linspace(0, 100, 2_000), 30))),
        ("two_speeds", recording_in_memory(SMOOTH, 0.0)),
        ("two_speeds", recording_in_memory(SMOOTH, np.where(np.arange(2_000) < 1_000, 25, 29))),
    ],
)
def test_what_is_usual_is_not_named(kind, recording):
    assert kind not in texts(driven(recording))


def test_a_smooth_drive_of_three_cameras_lacks_recoveries_alone():
    assert texts(driven(SMOOTH)).keys() == {"no_recoveries"}


def test_an_unknown_rig_is_named_in_place_of_a_replay_that_would_stop():
    oddities = texts(replace(recording_in_memory(SMOOTH, np.zeros(2_000)), rig=None))
    assert "drivezoo new rig" in oddities["no_rig"]
    assert "data.rig=donkey_sim" in oddities["no_rig"]
    assert not any("drivezoo replay" in text for text in oddities.values())


def test_a_remedy_for_side_cameras_is_not_offered_without_them_or_their_places():
    with_sides = recording_in_memory(SMOOTH, TWO_SPEEDS)
    assert "data.recover_s" not in texts(replace(with_sides, rig=None))["two_speeds"]
    centre = replace(with_sides, images=np.where([True, False, False], with_sides.images, None))
    assert "two_speeds" not in texts(centre)
    half = np.arange(2_000) < 1_000
    one_without = recording_in_memory(SMOOTH, np.where(half, 25, 0))
    one_without = replace(one_without, names=("a", "b"), recording=np.where(half, 0, 1))
    assert "two_speeds" not in texts(one_without)


def test_an_image_that_several_rows_name_is_a_duplicate():
    recording = recording_in_memory(SMOOTH)
    recording.images[7] = recording.images[6]
    text = texts(recording)["duplicates"]
    assert text.startswith("3 of 6,000 images")
    assert "delete" in text


def test_a_copied_folder_of_a_recording_is_a_duplicate(tmp_path):
    folders = [str(write_recording(tmp_path / name, rows=6).folder) for name in ("a", "b")]
    text = texts(read_recordings(folders))["duplicates"]
    assert text.startswith(f"{folders[1]} is a copy of {folders[0]}: ")
    other = write_recording(tmp_path / "c", rows=6, seed=1).folder
    assert "is a copy" not in str(texts(read_recordings([folders[0], str(other)])))


def test_an_edited_copy_shares_the_images_of_its_source(tmp_path: Path) -> None:
    source = write_recording(tmp_path / "lap", 20, cameras=("center",))
    write_edited(read_recordings(str(source.folder)), drop(Edits(20), (5, 9)), tmp_path / "new")
    text = texts(read_recordings([str(source.folder), str(tmp_path / "new")]))["duplicates"]
    assert text.startswith("16 of 36 images are named a second time")


def test_an_image_that_repeats_the_row_befores_is_a_duplicate(tmp_path):
    written = write_recording(tmp_path / "lake", rows=6)
    for row in range(1, 6):
        shutil.copy(written.image(0), written.image(row))
    recording = read_recordings(str(written.folder))
    assert texts(recording)["duplicates"].startswith("5 of 6 ")
    assert "duplicates" not in texts(replace(recording, speed_mph=np.zeros(6))), "it stands still"


@pytest.mark.slow
@pytest.mark.parametrize(("noise", "missing"), [(0.0, True), (1.0, False)])
def test_the_experts_recordings_lack_recoveries_without_noise_alone(tmp_path, noise, missing):
    options = RecordOptions(
        track="lake", out=str(tmp_path / "lake"), laps=0.25, noise=noise, seed=1, quality="simple"
    )
    names = texts(read_recordings(str(record_laps(options))))
    assert ("no_recoveries" in names) == missing
    assert "keyboard" not in names
    assert "two_speeds" not in names
    assert "duplicates" not in names


ROWS = 600


def test_the_sharpest_bend_comes_first_and_each_bend_once() -> None:
    steering = np.zeros(ROWS)
    steering[100:130], steering[300:330], steering[500] = 0.2, -0.6, 1.0
    bends = notable.sharpest_bends(recording_in_memory(steering))
    assert [300 <= bends[0].row < 330, 100 <= bends[1].row < 130] == [True, True]
    assert [round(bend.value, 6) for bend in bends[:2]] == [-0.6, 0.2]
    assert len([bend for bend in bends if 290 < bend.row < 340]) == 1


def test_a_jump_is_between_two_rows_that_follow_each_other() -> None:
    steering = np.zeros(ROWS)
    steering[200:], steering[400:] = 0.5, -0.4
    recording = recording_in_memory(steering)
    assert [jump.row for jump in notable.steering_jumps(recording)] == [400, 200]
    time_s = recording.time_s + np.where(np.arange(ROWS) < 400, 0, 60)
    assert [jump.row for jump in notable.steering_jumps(replace(recording, time_s=time_s))] == [200]


def test_standstills_are_listed_by_length() -> None:
    speed = np.full(ROWS, 20.0)
    speed[:3], speed[50:60] = 0, 0.5
    stops = notable.standstills(recording_in_memory(np.zeros(ROWS), speed))
    assert [(stop.row, stop.value) for stop in stops] == [(50, 10), (0, 3)]


def test_an_odd_frame_differs_from_both_neighbours() -> None:
    differences = np.full(ROWS, 5.0)
    differences[0] = np.nan
    differences[100:102] = 60  # one foreign frame
    differences[300] = 60  # another scene begins
    differences[400:460] = 40  # a bend
    differences[500], differences[501] = np.inf, np.nan
    frames = notable.odd_frames(recording_in_memory(np.zeros(ROWS)), differences)
    assert [frame.row for frame in frames] == [500, 100]
    assert frames[1].value == pytest.approx(12)


def test_the_largest_error_comes_first() -> None:
    predicted = np.full(ROWS, np.nan)
    predicted[:300], predicted[50], predicted[200] = 0.01, 0.3, -0.5
    errors = notable.largest_errors(recording_in_memory(np.zeros(ROWS)), predicted)
    assert [(error.row, error.value) for error in errors] == [(200, -0.5), (50, 0.3)]


def test_thumbnails_of_neighbours_are_alike(recorded: Written) -> None:
    image, following, far = (notable.thumbnail(str(recorded.image(row))) for row in (10, 11, 60))
    assert image.shape == (20, 40)
    assert 0 < notable.frame_difference(image, following) < notable.frame_difference(image, far)


def test_what_is_no_image_has_no_thumbnail(tmp_path, recorded: Written) -> None:
    data = recorded.image(1).read_bytes()
    for name, contents in (("text.jpg", b"no image"), ("half.jpg", data[: len(data) // 2])):
        (tmp_path / name).write_bytes(contents)
        with pytest.raises(ValueError, match=r"no JPEG|truncated"):
            notable.thumbnail(str(tmp_path / name))
    png = cv2.imencode(".png", np.zeros((8, 8, 3), np.uint8))[1].tobytes()
    (tmp_path / "small.png").write_bytes(png)
    assert notable.thumbnail(str(tmp_path / "small.png")).shape == (20, 40)


@pytest.mark.parametrize("seconds", [3600, -3600], ids=["pause", "step back"])
def test_a_pause_or_a_step_back_in_time_is_a_gap_and_no_driving(seconds):
    recording = recording_in_memory(np.zeros(30))
    recording.time_s[29] += seconds
    (report,) = report_recordings(recording)
    assert (report.gaps, report.seconds) == (1, pytest.approx(28 / 15, abs=0.01))


def test_rows_seconds_and_rate_agree_where_a_simulator_drives_in_whole_steps():
    recording = recording_in_memory(np.zeros(301))
    recording.time_s[:] = np.ceil(np.arange(301) / 15 / 0.02 - 1e-6) * 0.02  # 0.06 or 0.08 s apart
    (report,) = report_recordings(recording)
    assert report.seconds * report.fps == pytest.approx(300)
    assert "20 s at 15.0 frames/s" in report_lines(recording)[0]


def test_rows_without_times_have_no_seconds():
    recording = recording_in_memory(np.zeros(3))
    recording.time_s[:] = np.nan
    (report,) = report_recordings(recording)
    assert np.isnan([report.seconds, report.fps]).all()
    assert "driven time unknown" in report_lines(recording)[0]


def test_a_speed_that_no_row_has_is_unknown_and_no_standstill():
    mixed = recording_in_memory(np.zeros(4), np.array([0, 0, 0, 9]))
    mixed = replace(mixed, names=("a", "b"), recording=np.array([0, 0, 1, 1]))
    speeds = [line.rpartition(", ")[2] for line in report_lines(mixed)]
    assert speeds == ["speed unknown", "mean 4.5 mph"]
    assert [(stop.row, stop.value) for stop in notable.standstills(mixed)] == [(2, 1)]


def test_a_line_a_recording_says_it_all(tmp_path):
    full = write_recording(tmp_path / "one", rows=60)
    center = write_recording(tmp_path / "two", rows=3, cameras=("center",))
    first, second = report_lines(read_recordings([str(full.folder), str(center.folder)]))
    assert first.startswith(f"{full.folder}: 60 rows, 3 cameras, 4 s at 15.0 frames/s")
    assert "0 gaps" in first
    assert "0 gaps" in second, "the time between two recordings is no gap of either"
    assert f"{(full.steering == 0).mean():.0%} of steering exactly 0" in first
    assert f"mean {full.speed_mph.mean():.1f} mph" in first
    assert second.startswith(f"{center.folder}: 3 rows, centre camera only")

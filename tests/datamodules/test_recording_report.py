import re

import numpy as np
import pytest

from datamodules.findings import report_lines, report_recordings
from datamodules.recording_format import read_recordings
from tests.recordings import Written, write_recording


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

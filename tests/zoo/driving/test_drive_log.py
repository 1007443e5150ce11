"""Drives are readable after writing, also when a kill or a full disk cut them off."""

import json
import math
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from datamodules.formats.udacity import times_from_names
from zoo.base.errors import InputError
from zoo.base.notices import Notices
from zoo.driving.drive_log import DriveWriter, read_drive, write_drive, write_summary
from zoo.driving.drive_record import EMBEDDED, SOCKET, Drive, DriveRow
from zoo.driving.metrics import METRICS, measure
from zoo.driving.tally import Tally
from zoo.server.drive_writer import WAITING, BackgroundWriter
from zoo.simulator.recorder import PAUSE_S

ROWS = [
    DriveRow(0.0, 1, "policy", "IMG/a,b.jpg", -0.25, 0.5, 9.25, 0.125, False, 1.5, 0.04, -0.2),
    DriveRow(0.5, 2, "person", intervention=True),
]


def test_a_drive_is_read_as_it_was_written(tmp_path: Path) -> None:
    writer = DriveWriter(tmp_path / "drive")
    writer.add(ROWS)
    writer.close()
    write_summary(tmp_path / "drive", {"autonomy": math.nan, "telemetry": 2})
    drive = read_drive(tmp_path / "drive")
    assert len(drive) == 2
    assert drive.summary == {"version": 1, "autonomy": None, "telemetry": 2}
    assert drive.frame.tolist() == ["IMG/a,b.jpg", ""]
    assert drive.driver.tolist() == ["policy", "person"]
    assert drive.client.tolist() == [1, 2]
    assert drive.intervention.tolist() == [False, True]
    assert drive.cross_track_m[0] == 0.125
    assert math.isnan(drive.speed_mph[1])
    assert (drive.spread[0], drive.expert_steering[0]) == (0.04, -0.2)
    assert math.isnan(drive.spread[1])


def test_a_drive_that_is_read_has_the_figures_of_the_drive(tmp_path: Path) -> None:
    rows = [DriveRow(0.1 * number, speed_mph=9.0 + number / 3) for number in range(4)]
    facts: dict = {"driven_m": 23.9, "length_m": 10.0, "lap_s": (1.0, 2.0), "episode_return": 7.0}
    drive = Drive.of(rows, source=EMBEDDED, track="lake", **facts)
    write_drive(tmp_path, drive)
    np.testing.assert_equal(measure(read_drive(tmp_path)), measure(drive))


def test_a_drive_on_a_socket_has_the_metrics_of_one_in_the_embedded_world(tmp_path: Path) -> None:
    rows = [DriveRow(0.1 * number, speed_mph=9.0, cross_track_m=0.5) for number in range(4)]
    write_drive(tmp_path / "embedded", Drive.of(rows, source=EMBEDDED, track="lake"))
    writer = BackgroundWriter(tmp_path / "socket", Notices())
    for row in rows:
        writer.put(row, None)
    writer.close({"track": "lake", **Tally().figures()})
    embedded, socket = (read_drive(tmp_path / name) for name in ("embedded", "socket"))
    assert (embedded.source, socket.source) == (EMBEDDED, SOCKET)
    assert embedded.track == socket.track == "lake"
    assert METRICS.keys() & embedded.summary.keys() == METRICS.keys() & socket.summary.keys()
    assert socket.summary["cte_mean_m"] == embedded.summary["cte_mean_m"] == 0.5


@pytest.mark.parametrize("version", [{}, {"version": 2}])
def test_a_drive_of_an_unknown_version_is_refused(version: dict, tmp_path: Path) -> None:
    DriveWriter(tmp_path).add(ROWS)
    (tmp_path / "drive.json").write_text(json.dumps(version | {"track": "lake"}))
    with pytest.raises(InputError, match=r"drive\.json: .*version"):
        read_drive(tmp_path)


def test_what_is_no_drive_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"holds no drive\.csv"):
        read_drive(tmp_path)
    (tmp_path / "drive.csv").write_text("a,b\n1,2\n")
    with pytest.raises(InputError, match="its columns are not"):
        read_drive(tmp_path)
    with pytest.raises(InputError, match=r"holds a drive\.csv already"):
        DriveWriter(tmp_path)


def test_a_drive_that_was_cut_off_has_no_summary(tmp_path: Path) -> None:
    DriveWriter(tmp_path).add(ROWS)
    assert read_drive(tmp_path).summary == {}
    assert len(read_drive(tmp_path)) == 2


def test_the_same_picture_is_recorded_once(tmp_path: Path) -> None:
    writer = BackgroundWriter(tmp_path / "drive", Notices())
    for picture in (b"one", b"one", b"two", None):
        writer.put(DriveRow(0.0, speed_mph=9.0, throttle=-0.5), picture)
    assert writer.close(Tally().figures())
    frames = read_drive(tmp_path / "drive").frame
    assert frames[0] == frames[1] != frames[2]
    assert frames[3] == ""
    lines = (tmp_path / "drive" / "driving_log.csv").read_text().splitlines()
    assert len(lines) == 2
    assert lines[0].endswith(".jpg,,,0,0,0.5,9")


def test_images_have_the_times_of_the_drive(tmp_path: Path) -> None:
    writer = BackgroundWriter(tmp_path / "drive", Notices())
    times = [5.0, 5.1, 5.1, 5.2, 5.3, 0.2, 0.3]  # the last two are another simulator's
    for number, time_s in enumerate(times):
        writer.put(DriveRow(time_s), b"image %d" % number, begins=number == 4)
    writer.close({})
    lines = (tmp_path / "drive" / "driving_log.csv").read_text().splitlines()
    stamps = times_from_names([line.split(",")[0] for line in lines])
    steps = [0.1, 0.001, 0.1, PAUSE_S, PAUSE_S, 0.1]
    np.testing.assert_allclose(np.diff(stamps), steps, atol=0.0015)
    assert stamps[0] == pytest.approx(time.time() + time.localtime().tm_gmtoff, abs=60)


def test_a_disk_that_hangs_keeps_nobody(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    answers = threading.Event()
    monkeypatch.setattr(DriveWriter, "add", lambda self, rows: answers.wait(60))
    writer = BackgroundWriter(tmp_path / "drive", Notices())
    for number in range(2 * WAITING + 1):
        writer.put(DriveRow(float(number)), None)
    assert not writer.close({}, timeout_s=0.05)
    assert "the end of the drive is not written: the disk does not answer" in writer.notices.counts
    answers.set()


def test_a_disk_that_is_too_slow_delays_nobody(tmp_path: Path) -> None:
    lines: list[str] = []
    writer = BackgroundWriter(tmp_path / "drive", Notices(lines.append))
    for number in range(20_000):
        writer.put(DriveRow(float(number)), None)
    writer.close({})
    written = len(read_drive(tmp_path / "drive"))
    dropped = writer.notices.counts.total()
    assert written + dropped == 20_000
    assert len(lines) == (dropped > 0)

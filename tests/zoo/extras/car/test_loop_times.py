"""Loop times: the formats that are read, and times that are refused."""

from pathlib import Path

import numpy as np
import pytest

from zoo.base.errors import InputError, UsageError
from zoo.driving.drive_log import write_drive
from zoo.driving.drive_record import Drive, DriveRow
from zoo.extras.car.loop_times import LoopTimes, read_loop_times

PROFILE = """
Part Profile Summary: (times in ms)
+-------------+--------+--------+--------+--------+--------+--------+--------+
|     part    |  max   |  min   |  avg   |  50%   |  90%   |  99%   | 99.9%  |
+-------------+--------+--------+--------+--------+--------+--------+--------+
|   PiCamera  |  0.09  |  0.03  |  0.03  |  0.03  |  0.04  |  0.05  |  0.09  |
|    Pilot    | 500.00 | 280.00 | 300.00 | 290.00 | 320.00 | 410.00 | 490.00 |
| FileWatcher |  9.04  |  0.07  |  4.97  |  5.08  |  5.28  |  6.41  |  8.98  |
| FileWatcher |  6.66  |  0.05  |  5.00  |  5.06  |  5.06  |  6.44  |  6.64  |
+-------------+--------+--------+--------+--------+--------+--------+--------+
"""


def read(folder: Path, text: str, rate: float = 20, part: str | None = None) -> LoopTimes:
    """Return the loop times of a file with a text."""
    path = folder / "times.csv"
    path.write_text(text)
    return read_loop_times(str(path), rate=rate, part=part)


def test_a_column_of_latencies_waits_for_the_rate_of_the_loop(tmp_path: Path) -> None:
    for text in ("latency_ms\n20\n80\n", "20\n80\n", "frame,latency_ms\n1,20\n2,80\n\n"):
        times = read(tmp_path, text)
        assert times.latency_ms.tolist() == [20, 80]
        assert times.loop_ms.tolist() == [50, 80]


def test_a_lost_frame_lengthens_the_loop_before_it(tmp_path: Path) -> None:
    times = read(tmp_path, "latency_ms,loop_ms\nlost,30\n10,40\nlost,50\n20,60\n")
    assert times.loop == ((0.09, 0.01), (0.09, 0.02))  # the first lost one ends the last loop
    assert times.rate_hz == pytest.approx(2 / 0.18)
    whole = times.improved()["no lost frames"]
    assert whole.loop_ms.sum() == 180
    assert whole.latency_ms.tolist() == [20, 10, 10, 20], "as of the frame before, not 0"


@pytest.mark.parametrize("lost", [0, 12, 150])
def test_no_improvement_takes_a_lost_frame_for_a_delay_of_0(tmp_path: Path, lost: int) -> None:
    cells = ["400"] * 300
    cells[: 2 * lost : 2] = ["lost"] * lost
    times = read(tmp_path, "\n".join(["latency_ms", *cells]))
    assert times.delay_ms == 400
    for name, better in times.improved().items():
        assert better.delay_ms == (200 if name in ("half the delay", "both") else 400)
        assert better.rate_hz >= times.rate_hz


def test_times_are_drawn_between_the_quantiles_of_a_profile(tmp_path: Path) -> None:
    times = read(tmp_path, PROFILE)
    others_ms = 0.03 + 4.97 + 5.00
    assert np.median(times.latency_ms) == pytest.approx(290 + others_ms, abs=0.5)
    assert np.percentile(times.latency_ms, 90) == pytest.approx(320 + others_ms, abs=0.5)
    assert 280 + others_ms <= times.latency_ms.min() < times.latency_ms.max() <= 500 + others_ms
    assert (times.loop_ms == times.latency_ms).all()
    camera = read(tmp_path, PROFILE, rate=2, part="PiCamera")
    assert camera.loop_ms.tolist() == [500] * len(camera.loop_ms)
    with pytest.raises(UsageError, match=r"part=PiCamra.*PiCamera"):
        read(tmp_path, PROFILE, part="PiCamra")


@pytest.mark.parametrize(
    ("slow", "fast", "pilot"),
    [
        ("TubWriter", "KerasLinear", "KerasLinear"),
        ("PiCamera", "TensorRTLinear", "TensorRTLinear"),
        ("TubWriter", "FastAILinear", "FastAILinear"),
        ("UserPilotCondition", "MyPilot", "MyPilot"),
        ("ResNet18", "KerasLocalizer", "ResNet18"),
        ("TubWriter", "MyNet", "TubWriter"),
    ],
)
def test_the_pilot_is_found_by_its_name(tmp_path: Path, slow: str, fast: str, pilot: str) -> None:
    table = PROFILE.replace("    Pilot    ", f" {slow} ").replace("   PiCamera  ", f" {fast} ")
    times = read(tmp_path, table)
    assert f": {pilot} (" in times.words
    assert ("part=NAME" in times.words) == (pilot == "TubWriter"), "a guess is said"


def test_a_drive_holds_its_own_times(tmp_path: Path) -> None:
    seconds = [0.0, 0.1, 0.3, 20.0, 20.1]  # between the third and the fourth the client paused
    rows = [DriveRow(time_s=second, steering=0.0, latency_ms=5.0 + second) for second in seconds]
    write_drive(tmp_path, Drive.of(rows))
    times = read_loop_times(str(tmp_path), rate=20)
    assert times.loop_ms.round().tolist() == [100, 200, 100]
    assert times.latency_ms.tolist() == [5, 5.1, 25]


def test_an_improvement_changes_one_property(tmp_path: Path) -> None:
    improvements = read(tmp_path, "100\n200\n").improved()
    assert improvements["half the delay"].loop == ((0.1, 0.05), (0.2, 0.1))
    assert improvements["twice the frame rate"].loop == ((0.05, 0.1), (0.1, 0.2))
    assert improvements["no jitter"].loop == ((0.15, 0.15),) * 2
    lossy = read(tmp_path, "100\nlost\n200\n", rate=10).improved()
    assert set(lossy["no jitter"].latency_ms) == {150}
    assert "no jitter" not in read(tmp_path, "100\n100\n").improved()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("latency_ms\n5\n-1\n", ("row 3", "'-1'", "lost")),
        ("latency_ms\n5\n\n7\n", ("row 3", "lost")),
        ("latency_ms\n10000\n", ("row 2", "'10000'", "delete the row")),
        ("latency_ms\nnan\n", ("row 2", "milliseconds")),
        ("latency_ms,loop_ms\n5,0\n", ("row 2", "loop_ms", "milliseconds")),
        ("latency_ms,loop_ms\n5\n", ("row 2", "milliseconds")),
        ("30,50\n35,55\n", ("row 1", "2 columns", "latency_ms,loop_ms")),
        ("speed,time\n5,6\n", ("latency_ms", "speed")),
        ("latency_ms\n0.2\n0.25\nlost\n1.5\n", ("seconds", "milliseconds (250)", "0 for")),
        ("latency_ms,loop_ms\n0.2,0.3\n", ("seconds", "milliseconds (200)")),
        ("latency_ms,loop_ms\n50,0.3\n", ("loop_ms is 0.3", "seconds", "milliseconds (300)")),
        ("lost\nlost\n", ("all frames are lost",)),
        ("", ("0 times",)),
        (PROFILE.replace("280.00", "-3"), ("part Pilot", "min")),
        (PROFILE.replace("  90%   |", ""), ("expected 7",)),
        (PROFILE.split("|   PiCamera")[0], ("no parts",)),
    ],
)
def test_impossible_times_are_named(text: str, words: tuple[str, ...], tmp_path: Path) -> None:
    with pytest.raises(InputError) as error:
        read(tmp_path, text)
    for word in ("times.csv", *words):
        assert word in str(error.value)

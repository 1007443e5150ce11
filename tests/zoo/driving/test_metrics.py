"""The metrics of a drive: known values, and the page that defines them."""

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest

from zoo.checkpoints.policy_base import as_policy
from zoo.commands.results import results
from zoo.driving.drive_log import read_drive, write_drive
from zoo.driving.drive_record import PERSON, REPLAY, SOCKET, Drive, DriveRow
from zoo.driving.metrics import LOWER, METRICS, measure, metric
from zoo.driving.run_drives import all_drives
from zoo.driving.scenario import Scenario

PAGE = Path(__file__).parents[3] / "docs" / "metrics.md"
# Metrics of `drive_by_speed`, as the first version measured them.
MEASURED = {
    "autonomy": 0.0,
    "interventions": 6,
    "m_per_intervention": 39.64870424639569,
    "driven_m": 237.89222547837414,
    "driven_s": 27.46,
    "laps": 0.20048787357342235,
    "lap_s": math.nan,
    "cte_mean_m": 0.8696236985415546,
    "cte_rms_m": 1.2610058193713747,
    "cte_max_m": 3.27970947702204,
    "beyond_1m": 0.3269689737470167,
    "steering_per_s": 0.02454315963864464,
    "speed_mph": 19.564375905255844,
    "stalled": 0.0,
}


def drive_by_speed() -> Drive:
    """Drive a fifth of the lake with a policy that steers by its speed."""
    policy = as_policy(lambda _, mph: ((mph - 19.5) * 0.05, None))
    (drive,) = all_drives(policy, [Scenario("lake", 3, laps=0.2, speed=20)], renderer="none")
    return drive


def test_a_drives_figures_are_those_of_the_first_version() -> None:
    figures = measure(drive_by_speed())
    assert figures.pop("latency_ms") > 0
    assert figures == pytest.approx(MEASURED, rel=1e-12, nan_ok=True)
    assert list(figures) == list(MEASURED)


def test_the_rows_of_a_written_drive_give_the_figures_beside_them(tmp_path: Path) -> None:
    write_drive(tmp_path, drive_by_speed())
    written = json.loads((tmp_path / "drive.json").read_text())
    figures = measure(read_drive(tmp_path))
    of_world = ("driven_m", "m_per_intervention", "laps", "lap_s")  # not in the rows
    for name in METRICS.keys() & written.keys() - set(of_world):
        assert figures[name] == pytest.approx(written[name], abs=1e-3 if "ms" in name else 2e-5)


def test_a_world_without_a_length_counts_whole_laps() -> None:
    measured = replace(drive_by_speed(), length_m=math.nan)
    assert measure(replace(measured, lap_s=(60.0, 61.0)))["laps"] == 2
    assert math.isnan(measure(replace(measured, lap_s=()))["laps"])


def test_the_page_of_metrics_is_that_of_the_registry(capsys: pytest.CaptureFixture) -> None:
    results.main(["--metrics"])
    assert PAGE.read_text() == capsys.readouterr().out, (
        "run drivezoo results --metrics > docs/metrics.md"
    )


def test_two_metrics_of_one_name_are_refused() -> None:
    def autonomy(drive: Drive) -> float:
        """Another one."""
        return 0.0

    with pytest.raises(ValueError, match="autonomy"):
        metric("another", "1", LOWER, "a test")(autonomy)


def test_what_a_person_drove_on_the_socket_is_no_steering_of_the_policy() -> None:
    rows = [
        DriveRow(0.0, steering=0.5, speed_mph=10.0, cross_track_m=0.5),
        DriveRow(0.5, driver=PERSON, intervention=True),
        DriveRow(1.0, steering=0.25, speed_mph=20.0, cross_track_m=-0.25),
        DriveRow(1.5, steering=0.5),
    ]
    figures = measure(Drive.of(rows, source=SOCKET))
    assert figures["steering_per_s"] == 0.5, "0.25 in the 0.5 s that the policy alone drove"
    assert math.isnan(measure(Drive.of(rows[:3], source=SOCKET))["steering_per_s"])
    assert (figures["speed_mph"], figures["cte_mean_m"]) == (15.0, 0.375)
    assert figures["interventions"] == 1


def test_a_pause_on_the_socket_is_not_driven() -> None:
    rows = [DriveRow(time_s, speed_mph=10.0) for time_s in (0.0, 1.0, 60.0, 61.0)]
    figures = measure(Drive.of(rows, source=SOCKET))
    assert figures["driven_s"] == 2.0
    assert figures["driven_m"] == pytest.approx(2 * 4.4704)


def test_autonomy_is_not_known_where_nothing_judged_the_drive() -> None:
    rows = [DriveRow(0.0), DriveRow(60.0)]
    assert math.isnan(measure(Drive.of(rows))["autonomy"])
    rows[1] = DriveRow(60.0, driver=PERSON, intervention=True)
    assert measure(Drive.of(rows))["autonomy"] == pytest.approx(0.9)


def test_a_car_that_did_not_move_was_not_measured() -> None:
    rows = [DriveRow(float(second), cross_track_m=0.0, speed_mph=0.0) for second in range(5)]
    assert math.isnan(measure(Drive.of(rows, source=REPLAY, driven_m=0.0))["autonomy"])
    assert measure(Drive.of(rows, source=REPLAY, driven_m=9.0))["autonomy"] == 1
    rows[4] = DriveRow(60.0, cross_track_m=0.0, speed_mph=0.0, intervention=True)  # it stood still
    assert measure(Drive.of(rows, driven_m=0.0))["autonomy"] == pytest.approx(0.9)


def test_calibration_compares_the_spread_with_expert_and_error() -> None:
    spreads, errors = (0.1, 0.1, 0.2, 0.4, math.nan), (0.0, 0.1, -0.5, 2.0, 9.0)
    rows = [
        DriveRow(0.1 * row, steering=0.5, spread=std, cross_track_m=error, expert_steering=expert)
        for row, (std, error, expert) in enumerate(
            zip(spreads, errors, (0.69, 0.71, 0.12, -0.2, 0.5), strict=True)
        )
    ]
    figures = measure(Drive.of(rows))
    assert figures["spread_coverage"] == 0.75  # 0.71 is more than 1.96 x 0.1 from 0.5
    assert figures["spread_mean"] == pytest.approx(0.2)
    assert figures["spread_rank_cte"] == pytest.approx(0.9487, abs=1e-4)  # scipy's spearmanr


def test_a_spread_without_an_expert_has_no_calibration() -> None:
    socket = measure(Drive.of([DriveRow(0.0, spread=0.1), DriveRow(0.1, spread=0.1)]))
    assert socket["spread_mean"] == 0.1
    assert not {"spread_coverage", "spread_rank_cte"} & socket.keys()

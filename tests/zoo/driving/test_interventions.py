"""The rule of interventions, alone and on a socket."""

import json
import math
from collections.abc import Callable
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from tests.zoo.server.old_client import telemetry
from tests.zoo.server.serve import picture, red_policy
from zoo.base.notices import Notices
from zoo.checkpoints.policy_base import as_policy
from zoo.driving.drive_log import read_drive
from zoo.driving.interventions import OFF_ROAD, STANDSTILL, InterventionRule
from zoo.driving.speed_controller import PI, SpeedController, SteeringFilter
from zoo.server.drive_writer import BackgroundWriter
from zoo.server.driver import Driver

GREY = picture((102, 102, 102))
FRAME_S = 0.1


class Drive:
    """A driver without a socket, with one simulator that sends telemetry at 10 Hz."""

    def __init__(self, folder: Path, controller: SpeedController, **options: object) -> None:
        self.folder, self.lines = folder, []
        notices = Notices(self.lines.append)
        writer = BackgroundWriter(folder, notices)
        self.driver = Driver(red_policy, controller, SteeringFilter(), writer, notices, **options)
        self.session = self.driver.connect("a")
        self.now_s = 100.0

    def send(self, seconds: float = FRAME_S, speed: str = "9.0000", **more: str) -> dict:
        """Send telemetry for some seconds; return the values of the last reply."""
        for _ in range(round(seconds / FRAME_S)):
            message = {**telemetry(jpeg=GREY, speed=speed), **more}
            reply = self.driver.answer(self.session, message, self.now_s)
            self.driver.sent(reply, 1.0)
            self.now_s += FRAME_S
        return reply.values

    def take_over(self) -> None:
        self.driver.sent(self.driver.answer(self.session, None, self.now_s), 1.0)
        self.now_s += FRAME_S

    def end(self) -> str:
        """End the drive; return what is printed."""
        self.lines.clear()
        self.driver.end(datetime.now())
        return "\n".join(self.lines)

    @property
    def json(self) -> dict:
        return json.loads((self.folder / "drive.json").read_text())


Begin = Callable[..., Drive]


@pytest.fixture
def begin(tmp_path: Path) -> Begin:
    def begin_drive(controller: SpeedController | None = None, **options: object) -> Drive:
        return Drive(tmp_path / "drive", controller or PI(9, 0.1), **options)

    return begin_drive


def judge(rule: InterventionRule, seconds: float, **moment: float) -> list[str]:
    """Return the interventions of some seconds at 10 Hz."""
    values = {"speed_mph": 9.0, "cross_track_m": 0.0} | moment
    judged = [rule.judge(step / 10, **values) for step in range(round(10 * seconds) + 1)]
    return [kind for kind in judged if kind]


@pytest.mark.parametrize("moment", [{"cross_track_m": 3.1}, {"cross_track_m": -3.1}])
def test_beyond_the_margin_is_off_the_road_and_so_is_a_wall_that_holds_it(moment: dict) -> None:
    rule = InterventionRule(3.0)
    assert judge(rule, 1, **moment) == [OFF_ROAD]
    assert rule.state == OFF_ROAD
    assert judge(InterventionRule(3.2), 1, **moment) == []
    assert judge(InterventionRule(3.2), 1, **moment, at_wall=True) == [OFF_ROAD]


def test_a_car_that_stays_off_the_road_costs_at_least_the_time_that_it_is_off() -> None:
    for seconds in (1, 5.9, 6, 17, 60):
        interventions = judge(InterventionRule(3.0), seconds, cross_track_m=5.0)
        assert seconds <= 6 * len(interventions) < seconds + 6.1


def test_a_standstill_is_one_after_five_seconds_and_every_five() -> None:
    rule = InterventionRule(3.0)
    assert judge(rule, 5, speed_mph=0.9) == []
    assert rule.state is None
    assert judge(InterventionRule(3.0), 16, speed_mph=0.9) == [STANDSTILL] * 3
    assert judge(InterventionRule(3.0), 16, speed_mph=1.0) == []


def test_a_car_that_is_put_back_may_leave_again_at_once() -> None:
    rule = InterventionRule(3.0)
    assert rule.judge(0.0, 9.0, 4.0) == OFF_ROAD
    rule.restart()
    assert rule.judge(0.1, 9.0, 4.0) == OFF_ROAD


def test_leaving_the_road_is_counted_shown_and_written(begin: Begin) -> None:
    drive = begin()
    drive.send(30, cte="0.5000", lane="3.2000")
    assert drive.driver.latest().autonomy == 1
    assert drive.driver.latest().lost is None
    drive.send(4, cte="-5.7200", lane="3.2000")
    state = drive.driver.latest()
    assert (state.lost, state.interventions, state.off_road) == (OFF_ROAD, 1, 1)
    drive.send(26.1, cte="0.0000", lane="3.2000")
    assert drive.driver.latest().lost is None
    assert drive.driver.latest().interventions == 1

    assert "autonomy 90.0%: 1 intervention (1 off the road)" in drive.end()
    assert drive.json["autonomy"] == pytest.approx(0.9, abs=0.001)
    counts = {key: drive.json[key] for key in ("interventions", "off_road", "standstills")}
    assert counts == {"interventions": 1, "off_road": 1, "standstills": 0}
    assert drive.json["takeovers"] == 0
    record = read_drive(drive.folder)
    assert np.flatnonzero(record.intervention).tolist() == [300]
    assert record.driver[300] == "policy"


@pytest.mark.parametrize(
    ("margin_m", "lane", "lost"),
    [
        (None, {"lane": "2.0000"}, True),
        (None, {"lane": "2,0000"}, True),
        (None, {}, False),
        (1.0, {"lane": "2.8000"}, True),
        (3.0, {"lane": "2.0000"}, False),
        (None, {"lane": "3.2000", "wall": "1.0000"}, True),
    ],
)
def test_which_margin_counts(begin: Begin, margin_m: float | None, lane: dict, lost: bool) -> None:
    """The given one, or else the client's lane and its wall."""
    drive = begin(margin_m=margin_m)
    drive.send(1, cte="2.5000", **lane)
    assert drive.driver.latest().off_road == lost


def test_standing_still_is_counted_and_shown(begin: Begin) -> None:
    drive = begin()
    drive.send(11, speed="0.2000", cte="0.0000")
    state = drive.driver.latest()
    assert (state.lost, state.standstills, state.interventions) == (STANDSTILL, 2, 2)
    assert "2 interventions (2 standing still)" in drive.end()


@pytest.mark.parametrize("why", ["paused", "set speed 0"])
def test_a_car_that_the_driver_holds_does_not_stall(begin: Begin, why: str) -> None:
    drive = begin(PI(0 if why == "set speed 0" else 9, 0.1))
    drive.driver.paused = why == "paused"
    drive.send(11, speed="0.0000", cte="0.0000")
    assert drive.driver.latest().interventions == 0
    assert drive.driver.latest().lost is None


def test_a_simulator_without_cross_track_error_measures_no_autonomy(begin: Begin) -> None:
    drive = begin()
    drive.send(20)
    drive.send(10, speed="0.0000")
    state = drive.driver.latest()
    assert state.autonomy is None
    assert (state.interventions, state.lost) == (0, STANDSTILL)
    printed = drive.end()
    assert "autonomy: not measured" in printed
    assert "no cross-track error" in printed
    assert "nobody took over" in printed
    assert drive.json["autonomy"] is None
    assert drive.json["interventions"] == 0


def test_a_takeover_measures_autonomy_without_cross_track_error(begin: Begin) -> None:
    drive = begin()
    drive.send(40)
    drive.take_over()
    drive.send(20)
    assert drive.driver.latest().autonomy == pytest.approx(0.9, abs=0.001)
    assert "autonomy 90.0%: 1 intervention (1 taken over by hand)" in drive.end()
    assert (drive.json["takeovers"], drive.json["interventions"]) == (1, 1)


@pytest.mark.parametrize("cte", [{}, {"cte": "0.0000"}])
def test_a_single_telemetry_prints_no_nan(begin: Begin, cte: dict) -> None:
    drive = begin()
    drive.send(**cte)
    printed = drive.end()
    assert "nan" not in printed.lower()
    assert "1 telemetry" in printed
    assert "autonomy: not measured" in printed
    assert drive.json["autonomy"] is None
    assert drive.driver.latest().autonomy is None


def test_only_a_simulator_that_can_is_asked_to_put_the_car_back(begin: Begin) -> None:
    drive = begin(PI(12, 0.1))
    assert set(drive.send(cte="5.0000")) == {"steering_angle", "throttle"}
    drive.send(cte="0.0000")
    comma = {"steering_angle": "0,0000", "speed": "9,0000", "put_back": "1,0000"}
    assert drive.send(cte="5,0000", **comma)["put_back"] == "12,0000"
    assert "put_back" not in drive.send(cte="5.0000", put_back="1.0000"), "it was on its way"
    assert drive.driver.latest().off_road == 2


def test_a_policy_that_fails_off_the_road_is_counted(begin: Begin) -> None:
    drive = begin()
    drive.driver.policy = as_policy(lambda frame, speed_mph: (math.nan, None))
    drive.send(1, cte="5.0000")
    drive.end()
    record = read_drive(drive.folder)
    assert set(record.driver) == {"fallback"}
    assert record.intervention.sum() == drive.json["off_road"] == 1

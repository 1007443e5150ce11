"""Commands of the live page, and the state that it shows."""

import itertools
from collections.abc import Callable
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from datamodules.recording_format import read_recordings
from datamodules.view import View
from tests.zoo.server.old_client import telemetry
from tests.zoo.server.serve import picture, red_policy
from zoo.base.errors import InputError
from zoo.base.notices import Notices
from zoo.base.rig import CURVATURE, RIGS, UDACITY, Rig
from zoo.checkpoints.policy_base import Command, Policy, as_policy
from zoo.driving.drive_log import SUMMARY_NAME, read_drive, read_summary
from zoo.driving.drive_record import FALLBACK
from zoo.driving.speed_controller import PI, Constant, SpeedController, SteeringFilter
from zoo.driving.tally import autonomy_line
from zoo.server.drive_writer import BackgroundWriter
from zoo.server.driver import SILENCE_S, Driver
from zoo.server.session import Session
from zoo.server.telemetry_message import PUT_BACK, read_telemetry


class Counting(Policy):
    """A policy with memory: it steers by a hundredth more at each frame since its reset."""

    latency_s = 0.0

    def __init__(self) -> None:
        self.frames = 0

    def __call__(self, frame: np.ndarray, speed_mph: float) -> Command:
        self.frames += 1
        return Command(self.frames / 100, None, 0.05)

    def reset(self) -> None:
        self.frames = 0

    def session(self) -> "Counting":
        return Counting()


def frame(number: int, **more: object) -> dict:
    """Return the telemetry of a frame that differs from the others."""
    return {**telemetry(jpeg=picture((9 * number % 250, 90, 0)), speed="9.0000"), **more}


Make = Callable[..., Driver]
MOVING = telemetry(jpeg=picture((102, 0, 0)), speed="9.0000")


@pytest.fixture
def make(tmp_path: Path) -> Make:
    def make_driver(controller: SpeedController | None = None, **more: object) -> Driver:
        notices = Notices(lambda line: None)
        writer = BackgroundWriter(tmp_path / "drive", notices)
        return Driver(
            red_policy, controller or Constant(0.2), SteeringFilter(), writer, notices, **more
        )

    return make_driver


@pytest.mark.parametrize(("shape", "reported"), [((320, 640), 0), ((120, 160), 1)])
def test_another_shape_is_reported(shape: tuple[int, int], reported: int, make: Make) -> None:
    driver = make()
    driver.policy = Counting()
    driver.policy.view = View((40, 20), "rgb", (66, 200), frame=shape)
    assert driver.answer(driver.connect("a"), MOVING).row.driver != FALLBACK
    kinds = [kind for kind in driver.notices.counts if "shape" in kind]
    assert [driver.notices.counts[kind] for kind in kinds] == [1] * reported


def test_a_trouble_without_details_is_named_once(make: Make) -> None:
    driver, lines = make(), list[str]()
    driver.notices = Notices(lines.append)
    driver.answer(driver.connect("a"), {})
    assert lines[1:] == ["telemetry has no image (printed once, then counted)"]


UNKNOWN = ["NaN", float("nan"), "1e308", 1e308, -1e308, "Infinity", 10**400, None, "", [], 250]


@pytest.mark.parametrize("speed", UNKNOWN, ids=str)
def test_no_speed_is_held_while_the_cars_is_unknown(make: Make, speed: object) -> None:
    driver = make(PI(9, 0.1))
    session = driver.connect("a")
    for number in range(3):
        reply = driver.answer(session, frame(number, speed=speed), number / 15)
        assert reply.row.driver != FALLBACK
        assert reply.values["throttle"] == "0.0000"
    assert driver.notices.counts == {"speed is unknown; no speed is held": 3}
    standing = driver.answer(session, frame(3, speed="0.0000"), 3 / 15)
    assert float(standing.values["throttle"]) == pytest.approx(0.9)


@pytest.mark.parametrize("speed", [None, "0.0000"])
def test_a_car_without_a_speed_is_not_said_to_stand(make: Make, speed: object) -> None:
    driver = make()
    session = driver.connect("a")
    for number in range(20):
        driver.answer(session, frame(number, speed=speed, cte=0.0), number / 10)
    line = autonomy_line(driver.tally.figures())
    assert line == "autonomy: not measured (the car did not move, or sent no speed)"


def test_a_car_without_a_speed_is_left_out_of_the_mean_speed(make: Make) -> None:
    driver = make(record=True)
    unknown, known = driver.connect("a"), driver.connect("b")
    for number in range(20):
        driver.sent(driver.answer(unknown, frame(number, speed=None), number / 10), 1.0)
        driver.sent(driver.answer(known, MOVING, number / 10), 1.0)
    assert driver.tally.figures()["mean_speed_mph"] == pytest.approx(9)
    drive = read_drive(driver.end(datetime.now()))
    assert (drive.summary["speed_mph"], drive.summary["stalled"]) == (9, 0)
    assert np.isnan(drive.speed_mph[drive.client == 1]).all()
    assert read_recordings([drive.folder]).speed_mph.tolist() == [0] * 20


def test_a_paused_car_of_unknown_speed_does_not_reverse(make: Make) -> None:
    driver = make(PI(9, 0.1))
    session = driver.connect("a")
    driver.answer(session, MOVING)
    driver.paused = True
    assert driver.answer(session, frame(1, speed="NaN")).values["throttle"] == "0.0000"


@pytest.mark.parametrize("value", [1e308, "1e308", "NaN", -1e308])
@pytest.mark.parametrize("key", ["steering_angle", "cte", "lane", "lap", "x", "time", "wall"])
def test_a_value_that_no_car_has_is_as_if_not_sent(make: Make, key: str, value: object) -> None:
    driver = make(PI(9, 0.1))
    sent, unsent = driver.connect("a"), driver.connect("b")
    usual = frame(0, cte=0.5, time=1.0, x=1.0, y=2.0)
    with_value, without = usual | {key: value}, usual | {key: None}
    assert repr(read_telemetry(with_value)) == repr(read_telemetry(without))
    replies = driver.answer(sent, with_value, 1.0), driver.answer(unsent, without, 1.0)
    assert replies[0].values == replies[1].values
    assert replies[0].row.time_s == replies[1].row.time_s


def test_pause_brakes_and_steers_on(make: Make) -> None:
    driver = make()
    session = driver.connect("a")
    driver.paused = True
    reply = driver.answer(session, MOVING)
    assert reply.values == {"steering_angle": "0.4000", "throttle": "-0.2000"}
    driver.paused = False
    assert driver.answer(session, MOVING).values["throttle"] == "0.2000"


def test_set_speed_reaches_all_sessions_that_are_and_will_be(make: Make) -> None:
    driver = make(PI(9, 0.1))
    before = driver.connect("a")
    driver.set_speed(12)
    for session in (before, driver.connect("b")):
        assert driver.answer(session, MOVING).values["throttle"] == "0.3000"
    assert driver.latest().set_mph == 12
    with pytest.raises(ValueError, match="set_mph=nan: must be in 0"):
        driver.set_speed(float("nan"))
    with pytest.raises(ValueError, match=r"restart with speed=pi"):
        make(Constant(0.2)).set_speed(12)


def test_switching_keeps_the_old_checkpoint_if_the_new_does_not_load(make: Make) -> None:
    def load(path: Path) -> Callable:
        if path.name == "bad":
            raise InputError("no checkpoint")
        return lambda frame, speed: (-1.0, None)

    driver = make(load=load, checkpoint="first")
    session = driver.connect("a")
    with pytest.raises(InputError):
        driver.switch("bad")
    assert driver.answer(session, MOVING).values["steering_angle"] == "0.4000"
    assert driver.latest().checkpoint == "first"
    driver.switch("good")
    assert driver.answer(session, MOVING).values["steering_angle"] == "-1.0000"
    assert driver.latest().checkpoint == "good"


class Bend(Policy):
    """A network of data.label=curvature, which predicts a bend to the right."""

    data = {CURVATURE: 0.1625}  # noqa: RUF012

    def __call__(self, frame: np.ndarray, speed_mph: float) -> Command:
        return self.for_car(Command(0.3))


@pytest.mark.parametrize(("rig", "steering"), [(UDACITY, 0.3186), (RIGS["donkey_sim"], 0.4978)])
def test_a_curvature_is_steered_by_the_driven_car(make: Make, rig: Rig, steering: float) -> None:
    driver = make()
    assert driver.writer.rig == UDACITY
    driver.writer.rig = rig
    driver.load = lambda path: Bend().in_car(UDACITY)
    driver.switch("bend.ckpt")
    assert driver.answer(driver.connect("a"), MOVING, 0.0).row.steering == pytest.approx(
        steering, abs=1e-4
    )


def test_a_drive_names_each_network_that_drove(make: Make) -> None:
    driver = make(load=lambda path: Counting(), checkpoint="first")
    session = driver.connect("a")
    for name in ("second", "first", "unused"):
        driver.sent(driver.answer(session, MOVING), 1.0)
        driver.switch(name)
    driver.policy.engine = {"name": "unused"}
    summary = read_summary(driver.end(datetime.now()) / SUMMARY_NAME)
    assert (summary["checkpoint"], summary["engines"]) == ("first, second", [])


@pytest.mark.parametrize("names", ["a", "ab"])
def test_a_track_is_named_if_one_simulator_drove(make: Make, names: str) -> None:
    driver = make(track="lake")
    for name in names:
        driver.sent(driver.answer(driver.connect(name), MOVING), 1.0)
    assert read_drive(driver.end(datetime.now())).track == ("lake" if names == "a" else "")


def test_the_latest_state_is_that_of_the_first_simulator_that_drives(make: Make) -> None:
    driver = make()
    assert driver.latest().frame is None
    assert driver.latest().autonomy is None
    first, second = driver.connect("a"), driver.connect("b")
    dim = telemetry(jpeg=picture((51, 0, 0)))
    for now in (0.0, 0.1):
        driver.sent(driver.answer(first, MOVING, now), 2.0)
        driver.sent(driver.answer(second, dim, now), 3.0)
    state = driver.latest()
    assert state.steering == pytest.approx(0.4, abs=0.01)
    assert (state.clients, state.telemetry, state.latency_ms) == (2, 4, 2.0)
    assert state.frame[0, 0, 0] == pytest.approx(102, abs=2)
    driver.sent(driver.answer(second, dim, 5.0), 3.0)
    assert driver.latest().steering == pytest.approx(0.2, abs=0.01), "the first has gone silent"


def test_only_one_simulator_is_recorded(make: Make) -> None:
    driver = make(record=True)
    first, second = driver.connect("a"), driver.connect("b")
    assert driver.answer(first, MOVING, 0.0).image
    assert driver.answer(second, MOVING, 0.1).image is None
    driver.recording = False
    assert driver.answer(first, MOVING, 0.2).image is None


def test_autonomy_counts_stretches_and_driven_time(make: Make) -> None:
    driver = make()
    session = driver.connect("a")
    for step in range(601):
        override = 100 <= step < 120 or 300 <= step < 301
        driver.answer(session, None if override else MOVING, step * 0.1)
    driver.answer(session, MOVING, 600.0)
    state = driver.latest()
    assert state.interventions == 2
    assert state.driven_s == pytest.approx(60, abs=0.2)
    assert state.autonomy == pytest.approx(0.8, abs=0.01)


def test_frames_before_the_first_readable_one_are_not_driven(make: Make) -> None:
    driver = make()
    judged, unreadable = driver.connect("a"), driver.connect("b")
    for step in range(101):
        image = {"image": ""} if step < 50 else {}
        driver.answer(judged, MOVING | {"cte": 0.0} | image, step * 0.1)
        driver.answer(unreadable, MOVING | {"cte": 0.0, "image": ""}, step * 0.1)
    figures = driver.tally.figures()
    assert figures["driven_s"] == pytest.approx(5)
    assert figures["autonomy"] == 1


def test_time_is_the_simulators_own_where_it_tells_it(make: Make) -> None:
    """Drive 60 s of simulated time in 1 s: a simulator that waits for replies can be that fast."""
    driver = make()
    session = driver.connect("a")
    for step in range(901):
        driver.answer(session, {**MOVING, "time": f"{step / 15:.4f}"}, now_s=100 + step / 900)
    assert driver.tally.driven_s == pytest.approx(60, abs=0.01)
    assert driver.tally.figures()["telemetry_per_s"] == pytest.approx(901, abs=2)
    driver.answer(session, None, now_s=101.1)
    assert driver.tally.figures()["autonomy"] == pytest.approx(0.9, abs=0.001)


def test_a_simulator_that_begins_anew_does_not_turn_the_clock_back(make: Make) -> None:
    driver = make()
    session = driver.connect("a")
    rows = [
        driver.answer(session, {**MOVING, "time": time}, now_s=now_s).row.time_s
        for time, now_s in (("5.0", 10.0), ("5.1", 10.01), ("0.0", 10.02), ("0.1", 10.03))
    ]
    assert rows == sorted(rows)


def test_leaps_of_a_simulators_clock_do_not_end_the_recording(make: Make) -> None:
    driver = make(record=True)
    session = driver.connect("a")
    for number, time in itertools.product(range(20), (-1e10, 9e9, 9e9 + 1)):
        driver.sent(driver.answer(session, frame(2 * number + (time > 9e9), time=time)), 1.0)
    driver.writer.close({})
    assert driver.writer.recorded == 40


def test_a_picture_that_is_sent_again_is_looked_at_once(make: Make) -> None:
    driver = make()
    looks: list[float] = []

    def look(_: np.ndarray, speed_mph: float) -> tuple[float, None]:
        looks.append(speed_mph)
        return len(looks) / 10, None

    driver.policy = as_policy(look)
    session = driver.connect("a")

    def steer(speed: str, colour: tuple[int, int, int] = (9, 9, 9)) -> str:
        message = telemetry(jpeg=picture(colour), speed=speed)
        return driver.answer(session, message).values["steering_angle"]

    assert [steer("1.0000"), steer("1.0000")] == ["0.1000", "0.1000"]
    assert steer("2.0000") == "0.2000"
    assert steer("2.0000", (200, 0, 0)) == "0.3000"
    assert steer("2.0000") == "0.4000"
    driver.policy = as_policy(lambda frame, speed_mph: (0.7, None))  # as a page switches it
    assert steer("2.0000") == "0.7000"
    assert looks == [1, 2, 2, 2]


@pytest.fixture
def remembering(make: Make) -> Driver:
    driver = make()
    driver.policy = Counting()
    return driver


def steer(driver: Driver, session: Session, data: object, now_s: float) -> float:
    return float(driver.answer(session, data, now_s).values["steering_angle"])


def test_a_policy_remembers_a_simulators_frames_until_a_person_drives(remembering: Driver) -> None:
    first, second = remembering.connect("a"), remembering.connect("b")
    assert [steer(remembering, first, frame(n), n / 15) for n in range(3)] == [0.01, 0.02, 0.03]
    assert steer(remembering, second, frame(9), 0.2) == 0.01
    assert steer(remembering, first, frame(9), 0.3) == 0.04
    remembering.answer(first, None, 0.4)  # a person drives
    assert steer(remembering, first, frame(9), 0.5) == 0.01, "also if the frame is the last one"
    assert remembering.policy.frames == 0, "the loaded policy is for new sessions"


def test_a_policy_forgets_when_the_car_is_put_back(remembering: Driver) -> None:
    session, remembering.recording = remembering.connect("a"), True
    off = {"cte": "9.0000", "lane": "3.0000", "put_back": "1.0000"}
    assert steer(remembering, session, frame(0, cte="0.0000"), 0.0) == 0.01
    reply = remembering.answer(session, frame(1, **off), 0.1)
    assert reply.values["put_back"]
    assert reply.values["steering_angle"] == "0.0200"
    # The other loop of the client has sent a frame of the old place by then.
    under_way = remembering.answer(session, frame(2, **off), 0.1)
    assert PUT_BACK not in under_way.values
    assert reply.image
    assert under_way.image is None
    replies = [
        remembering.answer(session, frame(n, cte="0.0000", put_back="1.0000"), n / 10)
        for n in (3, 4)
    ]
    assert [each.values["steering_angle"] for each in replies] == ["0.0100", "0.0200"]
    assert [each.begins for each in replies] == [True, False]


def test_an_image_of_another_car_begins_a_stretch(make: Make) -> None:
    driver = make(record=True)
    first, second = driver.connect("a"), driver.connect("b")
    replies = [driver.answer(first, frame(0), 0.0)]
    replies += [driver.answer(second, frame(n), 0.4 * n * SILENCE_S) for n in range(1, 5)]
    assert [each.image is not None for each in replies] == [True, False, False, True, True]
    assert [each.begins for each in replies if each.image] == [True, True, False]


def test_a_policy_forgets_after_a_pause_and_a_restart_of_the_simulator(remembering: Driver) -> None:
    session = remembering.connect("a")
    times = {"5.0": 0.01, "5.1": 0.02, "7.0": 0.01, "7.1": 0.02, "0.0": 0.01, "0.1": 0.02}
    for number, (time, steering) in enumerate(times.items()):
        assert steer(remembering, session, frame(number, time=time), number / 10) == steering


@pytest.mark.parametrize("has_sessions", [True, False])
def test_a_simulator_that_connects_again_is_not_remembered(
    remembering: Driver, has_sessions: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not has_sessions:
        monkeypatch.delattr(Counting, "session")
    session = remembering.connect("a")
    assert [steer(remembering, session, frame(n), n / 15) for n in range(2)] == [0.01, 0.02]
    remembering.disconnect("a")
    assert steer(remembering, remembering.connect("a"), frame(2), 0.2) == 0.01


def test_the_latency_is_measured_from_the_telemetry(remembering: Driver) -> None:
    session = remembering.connect("a")
    sent = [0.0] * 4
    for number in range(40):
        degrees = f"{25 * sent[-4]:.4f}".replace(".", ",")
        reply = remembering.answer(session, frame(number, steering_angle=degrees), number / 10)
        sent.append(float(reply.values["steering_angle"].replace(",", ".")))
    policy = session._policy
    assert policy.latency_s == pytest.approx(0.3)
    remembering.answer(session, frame(99, steering_angle="?"), 4.0)
    assert policy.latency_s == pytest.approx(0.3)


def test_the_spread_is_recorded_and_shown(remembering: Driver) -> None:
    reply = remembering.answer(remembering.connect("a"), MOVING, 0.0)
    remembering.sent(reply, 1.0)
    assert reply.row.spread == remembering.latest().spread == 0.05
    remembering.policy = as_policy(red_policy)
    remembering.sent(remembering.answer(remembering.connect("b"), MOVING, 9.0), 1.0)
    assert remembering.latest().spread is None

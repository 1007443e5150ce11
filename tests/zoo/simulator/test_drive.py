"""`drivezoo simulator drive`: a person drives on its page."""

import re
import signal
import urllib.error

import numpy as np
import pytest

from datamodules.recording_format import read_recordings
from tests.zoo.command_runs import start
from tests.zoo.server.browser import Browser, needs_chromium
from tests.zoo.simulator.person import Person
from zoo.base.run_command import run_command
from zoo.commands.simulator import simulator
from zoo.simulator.hand_page import served_seat
from zoo.simulator.recorder import LOG_NAME


@pytest.fixture
def begin(tmp_path):
    """Start the command; return its process and a person who looks at its page."""
    processes = []

    def start_drive(*arguments: str):
        options = ("port=0", "quality=fast", "seconds=60", *arguments)
        process = start(tmp_path, "zoo.commands.simulator", "drive", *options)
        processes.append(process)
        person = Person(re.search(r"http://\S+", process.stdout.readline()).group())
        person.until(lambda state: "lap" in state)
        return process, person

    yield start_drive
    for process in processes:
        process.kill()
        process.wait()


def output(process) -> str:
    printed, _ = process.communicate(timeout=30)
    assert process.returncode == 0, printed
    return printed


def test_a_person_drives_off_to_the_left_and_records_it(tmp_path, begin):
    process, person = begin("out=mine")
    person.send(press="r")
    person.hold("arrow_up", "arrow_left")
    person.until(lambda state: state["rows"] >= 30)
    assert person.state["recording"]
    assert person.state["notice"].startswith("Off the road")
    person.send(press="escape")
    printed = output(process)
    recording = read_recordings(str(tmp_path / "mine"))
    assert re.search(rf"rows +{len(recording)} ", printed)
    assert f"wrote: mine/{LOG_NAME}\n" in printed
    assert re.search(r"off the road +\d+ rows", printed)
    assert "next: drivezoo edit mine" in printed
    assert recording.steering.min() == -1
    assert recording.steering.max() <= 0
    assert recording.throttle.max() == 1
    assert recording.speed_mph[0] < 1
    assert recording.speed_mph.max() > 5
    assert np.median(np.diff(recording.time_s)) == pytest.approx(1 / 15, abs=0.01)
    assert all(path is not None for path in recording.images.flat), "three cameras"


def test_r_pauses_the_recording_the_mouse_steers_and_ctrl_c_ends_the_drive(tmp_path, begin):
    process, person = begin("relative=true", "frame_rate=30")
    person.send(press="r")
    person.hold("mouse1", pointer=0.5)
    person.send(press="space")
    person.until(lambda state: state["rows"] >= 8)
    person.hold("mouse1", pointer=0.75)
    person.until(lambda state: state["rows"] >= 16)
    assert person.state["cruising"]
    person.send(press="r")
    paused = person.until(lambda state: not state["recording"])["rows"]
    later = person.state["lap_s"] + 0.3
    assert person.until(lambda state: state["lap_s"] > later)["rows"] == paused
    person.send(press="backspace")
    person.send(press="r")
    person.until(lambda state: state["rows"] >= paused + 5)
    process.send_signal(signal.SIGINT)
    assert "experiment=first_try data.root=recordings" in output(process)
    (folder,) = (tmp_path / "recordings").iterdir()
    recording = read_recordings(str(folder))
    # A quarter of the view's width; two thirds would be full lock.
    assert recording.steering[0] == 0
    assert recording.steering[paused - 1] == pytest.approx(0.25 / (2 / 3), abs=0.01)
    assert recording.throttle[paused - 1] == pytest.approx(0.4)
    assert np.count_nonzero(np.diff(recording.time_s) > 1) == 1
    assert recording.speed_mph[paused] < 0.5


def test_a_drive_without_recording_leaves_no_files(tmp_path, begin):
    process, person = begin("track=mountain")
    person.send(press="escape")
    assert output(process) == "nothing was recorded; press R while driving to record\n"
    assert list(tmp_path.iterdir()) == []


def test_no_time_passes_and_no_key_is_held_while_no_page_looks(monkeypatch):
    with served_seat(lambda line: None) as seat:
        assert not seat.watched
        seat.answer({"after": ["1"]})
        seat.take("hands", "held")
        assert seat.watched
        assert seat.hands == "held"
        monkeypatch.setattr("zoo.simulator.hand_page.WATCHED_S", 0.0)
        assert not seat.watched
        assert seat.hands != "held"


def test_late_frames_are_dropped_not_queued():
    lines: list[str] = []
    with served_seat(lines.append) as seat:
        person = Person(re.search(r"http://\S+", lines[0]).group())
        for value in range(10):
            seat.show(np.zeros((2, 2, 3), np.uint8), value=value)
        assert person.look()["value"] == 9
        number = person.state["number"]
        assert person.look()["number"] == number, "there is no newer one"


def test_a_command_that_is_none_is_refused():
    lines: list[str] = []
    with served_seat(lines.append):
        person = Person(re.search(r"http://\S+", lines[0]).group())
        for sent in (
            {"press": "x"},
            {"press": 1},
            {"hands": {"held": list("abcdefghijklmnopqrst")}},
            {"hands": {"stick": 2}},
            {"hands": {"pointer": float("nan")}},
            {"hands": []},
            {"fly": True},
        ):
            with pytest.raises(urllib.error.HTTPError, match="400"):
                person.send(**sent)


@needs_chromium
def test_keys_drive_in_a_browser(tmp_path, begin):
    process, person = begin("out=mine")
    with Browser(tmp_path / "profile", 390, 844) as browser:
        browser.open(person.url)
        browser.wait_for("document.querySelector('[data-fact=lap]')?.textContent === '1'")
        browser.click("[data-press=r]")
        for code in ("KeyW", "ArrowLeft"):
            browser.call("Input.dispatchKeyEvent", type="keyDown", code=code, key=code)
        browser.wait_for("Number(document.querySelector('[data-fact=rows]').textContent) > 15")
        assert browser.value("document.documentElement.scrollWidth <= innerWidth")
        for code in ("KeyW", "ArrowLeft"):
            release = {"type": "keyUp", "code": code, "key": code, "modifiers": 2}  # with Ctrl
            browser.call("Input.dispatchKeyEvent", **release)
        browser.wait_for("document.querySelector('[data-fact=throttle]').textContent === '0.00'")
        browser.click("[data-press=escape]")
        browser.wait_for("document.querySelector('.notice').textContent.includes('ended')")
        # The server has ended, so that what the page asks for next fails without an answer.
        assert not [line for line in browser.errors if "net::ERR_" not in line]
    assert "rows " in output(process)
    assert read_recordings(str(tmp_path / "mine")).steering.min() < -0.5


@pytest.mark.parametrize(
    ("argument", "words"),
    [
        ("directoin=1", "directoin: no such key; did you mean direction?"),
        ("port=-1", "port=-1: must be a whole number in 0..65535"),
        ("seconds=-1", "seconds=-1: must be a number of 0 or more"),
        ("out=held", "held: has a driving_log.csv already; give another folder with out="),
    ],
    ids=lambda text: text.partition(":")[0],
)
def test_a_mistake_is_one_line(here, argument, words, capsys):
    (here / "held").mkdir()
    (here / "held" / LOG_NAME).touch()
    assert run_command("drivezoo simulator", simulator, ["drive", argument]) in (1, 2)
    assert words in capsys.readouterr().err

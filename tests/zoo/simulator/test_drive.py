"""`drivezoo simulator drive` on a desktop with simulated keys and mouse."""

import os
import re
import signal
import subprocess
import time

import numpy as np
import pytest

from datamodules.recording_format import read_recordings
from tests.zoo.command_runs import command, environment, only_line, run_words
from tests.zoo.simulator.desktop import Desktop, open_desktop
from zoo.base.run_command import run_command
from zoo.commands.simulator import simulator
from zoo.simulator.recorder import LOG_NAME
from zoo.simulator.window import PIPES, Viewer

TITLE = "drivezoo simulator drive"
OPTIONS = ("width=640", "seconds=60")


@pytest.fixture(scope="module")
def desktop():
    with open_desktop() as opened:
        yield opened


@pytest.fixture
def begin(tmp_path, desktop):
    """Start the command; return its process when the window is visible."""
    processes = []

    def start(*arguments: str) -> subprocess.Popen:
        processes.append(
            subprocess.Popen(
                command("zoo.commands.simulator", "drive", *OPTIONS, *arguments),
                cwd=tmp_path,
                env=environment() | {"DISPLAY": desktop.name},
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
            )
        )
        # A drawn world has many colours; an empty screen has one.
        wait_until(lambda: desktop.image().std() > 20)
        return processes[-1]

    yield start
    for one in processes:
        one.kill()
        one.communicate()
    wait_until(lambda: desktop.image().std() < 20)


def wait_until(condition, seconds: float = 30.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "the condition never came true"
        time.sleep(0.05)


def rows(folder) -> int:
    log = folder / LOG_NAME
    return log.read_text().count("\n") if log.exists() else 0


def output(process: subprocess.Popen) -> str:
    printed, errors = process.communicate(timeout=30)
    assert process.returncode == 0, errors
    assert errors == ""
    return printed


def test_a_person_drives_off_to_the_left_and_records_it(tmp_path, desktop: Desktop, begin):
    process = begin("out=mine")
    desktop.tap("r")
    for key in ("Up", "Left"):
        desktop.key(key, True)
    wait_until(lambda: rows(tmp_path / "mine") >= 30)
    for key in ("Up", "Left"):
        desktop.key(key, False)
    desktop.tap("Escape")
    printed = output(process)
    recording = read_recordings(str(tmp_path / "mine"))
    assert re.search(rf"rows +{len(recording)} ", printed)
    assert str(tmp_path / "mine" / LOG_NAME) in printed
    assert re.search(r"off the road +\d+ rows", printed)
    assert "next: drivezoo edit mine" in printed
    assert recording.steering.min() == -1
    assert recording.steering.max() <= 0
    assert recording.throttle.max() == 1
    assert recording.speed_mph[0] < 1
    assert recording.speed_mph.max() > 5
    assert np.median(np.diff(recording.time_s)) == pytest.approx(1 / 15, abs=0.01)


def test_r_pauses_the_recording_and_the_mouse_steers(tmp_path, desktop: Desktop, begin):
    process = begin("relative=true", "frame_rate=30")
    desktop.tap("r")
    wait_until((tmp_path / "recordings").exists)
    (folder,) = (tmp_path / "recordings").iterdir()
    desktop.mouse(400, 300, button=True)
    desktop.tap("space")
    # 0.2 s are longer than a frame, so that the window gets the button before the move.
    wait_until(lambda: rows(folder) >= 8)
    desktop.mouse(560, 300)
    wait_until(lambda: rows(folder) >= 16)
    desktop.tap("r")
    time.sleep(0.3)
    paused = rows(folder)
    time.sleep(0.3)
    assert rows(folder) == paused
    desktop.tap("BackSpace")
    desktop.tap("r")
    wait_until(lambda: rows(folder) >= paused + 5)
    desktop.mouse(560, 300, button=False)
    desktop.tap("Escape")
    assert "experiment=first_try data.root=recordings" in output(process)
    recording = read_recordings(str(folder))
    # A quarter of the window's 640 pixels; two thirds would be full lock.
    assert recording.steering[0] == 0
    assert recording.steering[paused - 1] == pytest.approx(160 / 640 / (2 / 3), abs=0.01)
    assert recording.throttle[paused - 1] == pytest.approx(0.4)
    assert np.count_nonzero(np.diff(recording.time_s) > 1) == 1
    assert recording.speed_mph[paused] < 0.5


@pytest.mark.parametrize("how", [pytest.param("window closed", marks=pytest.mark.slow), "stopped"])
def test_a_recording_can_be_read_however_the_drive_ends(tmp_path, desktop: Desktop, begin, how):
    process = begin("out=mine", "track=mountain")
    desktop.tap("r")
    wait_until(lambda: rows(tmp_path / "mine") >= 5)
    if how == "stopped":
        process.send_signal(signal.SIGINT)
        assert process.communicate(timeout=30)[1] == "drivezoo simulator: stopped\n"
        assert process.returncode == 130
    else:
        desktop.close_window(TITLE)
        assert "rows " in output(process)
    assert len(read_recordings(str(tmp_path / "mine"))) >= 5


def test_a_drive_without_recording_leaves_no_files(tmp_path, begin, desktop: Desktop):
    process = begin()
    desktop.tap("Escape")
    assert "nothing was recorded" in output(process)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("pipe", PIPES)
def test_a_viewer_shows_frames(desktop: Desktop, monkeypatch, pipe):
    monkeypatch.setenv("DISPLAY", desktop.name)
    monkeypatch.setattr("zoo.simulator.window.PIPES", (pipe,))
    frame = np.zeros((160, 320, 3), np.uint8)
    frame[:80, :160], frame[80:, 160:] = (250, 0, 0), (0, 120, 250)
    viewer = Viewer("a test", (640, 320))
    try:
        assert all(viewer.show(frame) for _ in range(3))
        shown = desktop.image()[140:460, 80:720]  # the window is in the middle of 800 x 600
        assert shown[40, 40].tolist() == [250, 0, 0]
        assert shown[280, 600].tolist() == [0, 120, 250]
        assert shown[40, 600].tolist() == shown[280, 40].tolist() == [0, 0, 0]
        desktop.close_window("a test")
        wait_until(lambda: not viewer.show(frame))
    finally:
        viewer.close()
    assert not viewer.show(frame)


@pytest.mark.parametrize(
    "display", [None, *(pytest.param(one, marks=pytest.mark.slow) for one in ("", ":98765"))]
)
def test_without_a_display_the_error_is_one_line(tmp_path, monkeypatch, display):
    monkeypatch.setenv("DISPLAY", "")
    if display is None:
        monkeypatch.delenv("DISPLAY")
    elif display:
        monkeypatch.setenv("DISPLAY", display)
    # A new process, because Panda3D asks for a display only once.
    line = only_line(run_words(tmp_path, *command("zoo.commands.simulator", "drive", "out=mine")))
    assert line.startswith("drivezoo simulator: no window can be opened")
    assert "DISPLAY" in line
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("argument", "words"),
    [
        ("directoin=1", "directoin: no such key; did you mean direction?"),
        ("width=10", "width=10: must be a whole number in 320..7680"),
        ("seconds=-1", "seconds=-1: must be a number of 0 or more"),
        ("renderer=none", "renderer=none: must be auto, software or opengl"),
        ("out=held", "held: has a driving_log.csv already; give another folder with out="),
    ],
    ids=lambda one: one.partition(":")[0],
)
def test_a_mistake_is_one_line_before_a_window_opens(here, monkeypatch, argument, words, capsys):
    (here / "held").mkdir()
    (here / "held" / LOG_NAME).touch()
    # A window would fail here, with another words.
    monkeypatch.setitem(os.environ, "DISPLAY", "")
    assert run_command("drivezoo simulator", simulator, ["drive", argument]) in (1, 2)
    assert words in capsys.readouterr().err

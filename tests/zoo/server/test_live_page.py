"""The live page, with a real driver and a simulator that it drives."""

import io
import json
import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.zoo.command_runs import start
from tests.zoo.page_requests import ask
from tests.zoo.server.browser import Browser, needs_chromium
from tests.zoo.server.old_client import OldClient
from tests.zoo.server.serve import Served, picture, served
from zoo.server.live_page import MOST_POLLS, POLL_MS, PollInterval

text = "document.getElementById('{}').textContent".format
size = "document.documentElement.{}".format


@pytest.fixture(scope="module")
def folder(run_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the driver's folder, with checkpoints of two runs in `outputs`, one of them broken."""
    folder = tmp_path_factory.mktemp("page")
    for run in ("old", "new"):
        (folder / "outputs" / run / "checkpoints").mkdir(parents=True)
    shutil.copy(run_folder / "checkpoints" / "best.ckpt", folder / "outputs/old/checkpoints")
    (folder / "outputs/new/checkpoints/broken.ckpt").write_bytes(b"no checkpoint")
    return folder


@pytest.fixture(scope="module")
def driver(folder: Path) -> Iterator[Served]:
    """Yield a driver of the first checkpoint, with the embedded simulator."""
    options = ("outputs/old/checkpoints/best.ckpt", "drive.port=0", f"drive.record={folder}/drive")
    with served(folder / "drive", "zoo.commands.drive", *options) as driver:
        url = f"url=http://127.0.0.1:{driver.port}"
        options = ("client", url, "clock=realtime", "quality=simple", "start=60")
        simulator = start(folder, "zoo.commands.simulator", *options)
        try:
            yield driver
        finally:
            simulator.kill()
            simulator.wait()
        assert driver.stop() == 0, driver.lines
        assert not any("Traceback" in line for line in driver.lines), driver.lines


@pytest.fixture(autouse=True)
def _driving(driver: Served) -> None:
    """Let each test begin with a car that drives by the first checkpoint."""
    order(driver, pause=False)
    until(driver, lambda state: state["telemetry"] > 5 and state["speed_mph"] > 0.5)


def read_state(driver: Served) -> dict:
    status, _, body = ask(driver.port, "GET", "/state.json")
    assert status == 200
    return json.loads(body)


def order(driver: Served, **what: object) -> tuple[int, dict]:
    status, _, body = ask(driver.port, "POST", "/command", what)
    return status, json.loads(body)


def until(driver: Served, reached: Callable[[dict], bool], seconds: float = 15) -> dict:
    ends = time.monotonic() + seconds
    while not reached(state := read_state(driver)):
        assert time.monotonic() < ends, state
        time.sleep(0.05)
    return state


@pytest.mark.parametrize(
    ("path", "kind", "holds"),
    [
        ("/", "text/html", b"page.js"),
        ("/style.css", "text/css", b"prefers-color-scheme"),
        ("/page.js", "text/javascript", b"state.json"),
    ],
)
def test_the_page_is_in_the_package(driver: Served, path: str, kind: str, holds: bytes) -> None:
    status, answered, body = ask(driver.port, "GET", path)
    assert status == 200
    assert answered.startswith(kind)
    assert holds in body
    assert b"https://" not in body, "it would fetch something from elsewhere"


def test_the_state_is_that_of_the_drive(driver: Served) -> None:
    before = read_state(driver)
    state = until(driver, lambda now: now["telemetry"] > before["telemetry"] + 10)
    assert state["clients"] == 1
    assert state["autonomy"] is None, "nobody knows whether it stays on the road"
    assert 0 < state["latency_p50_ms"] <= state["latency_p99_ms"]
    assert state["cross_track_m"] is None, "the original's telemetry does not tell"
    assert state["checkpoint"] == "outputs/old/checkpoints/best.ckpt"


@pytest.mark.parametrize("path", ["/frame.jpg?n=1", "/saliency.jpg"])
def test_pictures_are_the_camera_s_size(driver: Served, path: str) -> None:
    status, kind, body = ask(driver.port, "GET", path)
    assert (status, kind) == (200, "image/jpeg"), body
    assert Image.open(io.BytesIO(body)).size == (320, 160)


def test_what_it_looks_at_is_green(driver: Served) -> None:
    plain, seen = (
        np.asarray(Image.open(io.BytesIO(ask(driver.port, "GET", path)[2])), float)
        for path in ("/frame.jpg", "/saliency.jpg")
    )
    greener = (seen[..., 1] - seen[..., 0]) - (plain[..., 1] - plain[..., 0])
    assert greener.max() > 80


def test_set_speed(driver: Served) -> None:
    assert order(driver, set_mph=12)[1]["set_mph"] == 12
    assert order(driver, set_mph=9)[1]["set_mph"] == 9


def test_recording_stops_and_goes_on(driver: Served) -> None:
    assert order(driver, record=False)[1]["recording"] is False
    time.sleep(0.2)
    before = read_state(driver)
    after = until(driver, lambda now: now["telemetry"] > before["telemetry"] + 6)
    assert after["recorded"] == before["recorded"]
    assert order(driver, record=True)[1]["recording"] is True
    until(driver, lambda now: now["recorded"] > before["recorded"])


def test_checkpoints_are_listed_newest_first(driver: Served) -> None:
    names = ["outputs/new/checkpoints/broken.ckpt", "outputs/old/checkpoints/best.ckpt"]
    assert json.loads(ask(driver.port, "GET", "/checkpoints.json")[2]) == names


def test_a_switch_takes_effect_and_one_to_a_broken_checkpoint_does_not(driver: Served) -> None:
    first = read_state(driver)["checkpoint"]
    status, answer = order(driver, switch="outputs/new/checkpoints/broken.ckpt")
    assert status == 400
    assert "broken.ckpt" in answer["error"]
    before = read_state(driver)
    assert before["checkpoint"] == first
    until(driver, lambda now: now["telemetry"] > before["telemetry"] + 5)
    whole = str(driver.folder.parent / first)
    assert order(driver, switch=whole)[1]["checkpoint"] == whole
    assert order(driver, switch=first)[1]["checkpoint"] == first


@pytest.mark.parametrize("path", ["outputs/old", "latest"])
def test_a_switch_takes_a_runs_folder_and_latest(path: str, driver: Served) -> None:
    first = read_state(driver)["checkpoint"]
    assert order(driver, switch=path)[1]["checkpoint"] == first


@pytest.mark.parametrize(
    ("body", "status"),
    [
        (b"", 400),
        (b"[" * 4000, 400),
        ({}, 400),
        ({"pause": True, "record": True}, 400),
        ({"fly": True}, 400),
        ({"pause": 1}, 400),
        ({"set_mph": "12"}, 400),
        ({"set_mph": True}, 400),
        (b'{"set_mph": NaN}', 400),
        (b'{"set_mph": 1' + b"0" * 400 + b"}", 400),
        ({"set_mph": -1}, 400),
        ({"switch": ""}, 400),
        ({"switch": "outputs/\0"}, 400),
        ({"switch": "x" * 4096}, 413),
    ],
)
def test_a_command_that_is_none_is_refused(driver: Served, body: object, status: int) -> None:
    before = read_state(driver)
    kind = "application/json"  # also of bytes that are none
    answered, _, answer = ask(driver.port, "POST", "/command", body, Content_Type=kind)
    assert answered == status, answer
    assert json.loads(answer)["error"]
    after = read_state(driver)
    for name in ("paused", "recording", "set_mph", "checkpoint"):
        assert after[name] == before[name]


def test_commands_of_another_origin_are_refused(driver: Served) -> None:
    for origin in ("http://example.org", "null", f"http://localhost:{driver.port}"):
        status, _, _ = ask(driver.port, "POST", "/command", {"pause": True}, Origin=origin)
        assert status == 403, origin
    page_origin = f"http://127.0.0.1:{driver.port}"
    assert ask(driver.port, "POST", "/command", {"pause": False}, Origin=page_origin)[0] == 200
    # Content types that a form of another site can send, by a browser that sends no Origin.
    for kind in ("text/plain", "application/x-www-form-urlencoded", ""):
        status, _, _ = ask(driver.port, "POST", "/command", {"pause": True}, Content_Type=kind)
        assert status == 415, kind
    assert not read_state(driver)["paused"]


@pytest.mark.parametrize(
    ("method", "path", "status"),
    [
        ("GET", "/command", 405),
        ("POST", "/state.json", 405),
        ("GET", "/page.py", 404),
        ("GET", "/../page.py", 404),
        ("GET", "/%2e%2e/%2e%2e/drive.py", 404),
    ],
)
def test_other_requests_are_refused(driver: Served, method: str, path: str, status: int) -> None:
    assert ask(driver.port, method, path)[0] == status


def test_a_class_that_looks_on_asks_no_more_often_than_a_few() -> None:
    interval, now_s = PollInterval(), 1000.0
    for pages, poll_ms in ((1, POLL_MS), (30, 30_000 / MOST_POLLS), (2, POLL_MS)):
        for _ in range(10 * MOST_POLLS):
            now_s += interval.poll_ms / 1000 / pages
            interval.asked(now_s)
        assert interval.poll_ms == pytest.approx(poll_ms, rel=0.1)


@needs_chromium
def test_a_person_watches_and_commands_in_a_browser(driver: Served, tmp_path: Path) -> None:
    with Browser(tmp_path / "profile", 1280, 800) as browser:
        browser.open(f"http://127.0.0.1:{driver.port}/")
        browser.wait_for(f"Number({text('speed-value')}) > 0")
        browser.wait_for("document.getElementById('frame').naturalWidth === 320")
        assert browser.value(text("status-text")) == "Driving"
        assert browser.value(text("autonomy")) == "not measured"
        assert browser.value(size("scrollWidth")) == 1280
        assert browser.value(size("scrollHeight")) == 800, "it fits without scrolling"

        browser.click("#look")
        browser.wait_for("document.getElementById('saliency').naturalWidth === 320")
        browser.screenshot(tmp_path / "page.png")
        assert Image.open(tmp_path / "page.png").size == (1280, 800)
        browser.click("#look")

        browser.click("#checkpoint")
        browser.wait_for("document.querySelectorAll('#list button').length === 2")
        browser.click("#list li")
        browser.wait_for(f"{text('message-text')}.includes('broken.ckpt')")
        browser.wait_for(f"{text('checkpoint-name')} === 'old / best.ckpt'")

        browser.click("#faster")
        browser.wait_for("document.getElementById('set-mph').value === '10'")
        browser.click("#slower")
        browser.wait_for("document.getElementById('set-mph').value === '9'")

        browser.click("#pause")
        browser.wait_for(f"{text('status-text')} === 'Paused'")
        assert read_state(driver)["paused"]
        browser.wait_for(f"{text('status-text')} === 'Paused' && {text('pause')} === 'Resume'")
        browser.click("#pause")
        browser.wait_for(f"{text('status-text')} === 'Driving'")
        # Only the command that the test made fail has failed.
        assert [line for line in browser.errors if "/command" not in line] == []

        browser.call("Network.enable")
        browser.call("Network.setBlockedURLs", urls=["*/frame.jpg*"])
        shown = read_state(driver)["telemetry"]
        until(driver, lambda state: state["telemetry"] > shown + 20)
        width = browser.value("document.getElementById('frame').naturalWidth")
        assert width == 320, "the last frame stays"


@needs_chromium
def test_the_page_turns_red_when_the_car_leaves_the_road(folder: Path, tmp_path: Path) -> None:
    options = ("outputs/old/checkpoints/best.ckpt", "drive.port=0", f"drive.record={tmp_path}/d")
    looks = "document.getElementById('{}').className".format
    with (
        served(folder / "x", "zoo.commands.drive", *options) as driver,
        OldClient(driver.port) as simulator,
        Browser(tmp_path / "profile", 1280, 800) as browser,
    ):
        jpeg = picture((102, 102, 102))

        def send(time_s: float, **values: str) -> None:
            simulator.telemetry(jpeg=jpeg, lane="3.2000", time=f"{time_s:.4f}", **values)
            simulator.reply()

        def shown(time_s: float, words: str, kind: str, **values: str) -> None:
            """Stop the simulator's clock until the page shows the words."""
            for _ in range(300):
                send(time_s, **values)
                if browser.value(f"{text('status-text')} === '{words}'"):
                    break
                time.sleep(0.05)
            assert browser.value(text("status-text")) == words
            assert browser.value(looks("status")) == kind

        browser.open(f"http://127.0.0.1:{driver.port}/")
        for time_s in np.arange(0, 30, 0.5):
            send(time_s, speed="9.0000", cte="0.5000")
        shown(30, "Driving", "good", speed="9.0000", cte="0.5000")
        assert browser.value(text("autonomy")) == "100.0 %"
        shown(30, "Off the road, 5.72 m left", "bad", speed="9.0000", cte="-5.7200")
        for time_s in np.arange(30, 36, 0.5):
            send(time_s, speed="0.0000", cte="0.0000")
        shown(36, "Standing still", "bad", speed="0.0000", cte="0.0000")
        shown(36, "Driving", "good", speed="9.0000", cte="0.0000")
        assert browser.value(text("interventions")) == "2"
        shown(36, "Left the road, put back", "bad", cte="5.7200", put_back="1.0000")
        assert browser.value(text("interventions")) == "3"
        assert browser.errors == []


@needs_chromium
def test_the_page_shows_the_band_of_a_policy_that_doubts(tmp_path: Path) -> None:
    serve = ("tests.zoo.server.serve", str(tmp_path / "drive"), "doubt")
    with (
        served(tmp_path / "drive", *serve) as driver,
        OldClient(driver.port) as simulator,
        Browser(tmp_path / "profile", 1280, 800, "dark") as browser,
    ):
        browser.open(f"http://127.0.0.1:{driver.port}/")
        browser.wait_for(f"{text('strip-name')} === 'Steering'")
        for number in range(8):
            red = round(60 + 40 * np.sin(number / 2))
            simulator.telemetry(jpeg=picture((red, 40, 8 if number < 4 else 25)), speed="9.0000")
            simulator.reply()
            time.sleep(0.1)
        browser.wait_for(f"{text('strip-name')}.includes('95 % band')")
        band_deg = float(str(browser.value(text("band"))).strip("± °"))
        assert band_deg == pytest.approx(1.96 * 25 / 255 * 25, abs=0.5)
        assert browser.value(size("scrollHeight")) == 800, "it fits without scrolling"
        browser.screenshot(tmp_path / "page.png")
        assert browser.errors == []

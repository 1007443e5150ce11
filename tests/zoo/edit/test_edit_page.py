"""The editing page, over HTTP and in a browser."""

import contextlib
import socket
import time
from pathlib import Path

import numpy as np
import pytest

from datamodules.recording_format import read_recordings
from tests.recordings import Written
from tests.zoo.base.test_process_pool import wait_until
from tests.zoo.edit.conftest import ServedPage
from tests.zoo.server.browser import Browser, needs_chromium
from zoo.base.page_server import MOST_REQUESTS


def wait_for_analysis(served: ServedPage) -> None:
    wait_until(lambda: served.read("/state.json")["analysed"] == 120)


def test_the_page_comes_from_the_package(served: ServedPage) -> None:
    for path, holds in (("/", b"page.js"), ("/page.js", b"timeline.js"), ("/style.css", b"--bad")):
        status, _, body = served.ask("GET", path)
        assert status == 200
        assert holds in body
        assert b"https://" not in body, "it would fetch something from elsewhere"


def test_the_columns_are_the_recorded_ones(served: ServedPage, recorded: Written) -> None:
    about = served.read("/recording.json")
    assert (about["rows"], about["cameras"], about["breaks"]) == (120, [True] * 3, [])
    columns = np.frombuffer(served.ask("GET", "/columns.bin")[2], "<f4").reshape(3, 120)
    np.testing.assert_allclose(columns[0], recorded.steering, atol=1e-6)
    np.testing.assert_allclose(columns[1], recorded.speed_mph, rtol=1e-6)
    np.testing.assert_allclose(columns[2], recorded.time_s - recorded.time_s[0], atol=1e-3)


def test_images_are_the_recorded_files(served: ServedPage, recorded: Written) -> None:
    for camera, name in enumerate(("center", "left", "right")):
        status, kind, body = served.ask("GET", f"/image?row=7&camera={camera}")
        assert (status, kind) == (200, "image/jpeg")
        assert body == recorded.image(7, name).read_bytes()


def test_only_images_are_shown(served: ServedPage) -> None:
    path = Path(served.page.recording.images[3, 0])
    path.write_text("a private file that a log names")
    status, _, body = served.ask("GET", "/image?row=3")
    assert status == 415
    assert b"private" not in body.replace(str(path).encode(), b"")
    for query in ("row=120", "row=-1", "row=x", "row=1&camera=3", "row=%C2%B2"):
        assert served.ask("GET", f"/image?{query}")[0] == 400
    assert served.ask("GET", "/../../etc/passwd")[0] == 404


def test_a_row_is_described_by_its_place(served: ServedPage) -> None:
    row = served.read("/row.json?row=7")
    assert row["place"].endswith("driving_log.csv, row 8")
    assert row["image"].startswith("center_")


def test_frames_are_analysed_and_predicted_in_the_background(served: ServedPage) -> None:
    wait_for_analysis(served)
    answer = np.frombuffer(served.ask("GET", "/predicted.bin?known=20")[2], "<f4")
    rows, predicted = answer.reshape(2, 100)
    assert len({*rows}) == 100
    assert ((predicted > 0.2) & (predicted < 0.8)).all()
    notable = served.read("/notable.json")
    assert notable["bends"][0][0] < 120
    assert len(notable["errors"]) > 1
    assert notable["frames"] == notable["standstills"] == []


def test_an_edit_changes_the_state_and_can_be_undone(served: ServedPage) -> None:
    assert served.order(drop=[10, 20])[1]["dropped"] == [[10, 20]]
    assert served.order(split=60)[1]["parts"] == [50, 60]
    assert served.order(undo=True)[1]["splits"] == []
    assert served.order(redo=True)[1]["splits"] == [60]


def shown(state: dict) -> str:
    return f"{state['session']}.{state['changes']}"


@pytest.mark.parametrize(
    ("other", "order"),
    [
        ({"drop": [10, 20]}, {"write": True}),
        ({"split": 60}, {"undo": True}),
        ({"undo": True}, {"redo": True}),
        ({"undo": True}, {"drop": [1, 2]}),
    ],
)
def test_a_page_that_shows_old_edits_neither_edits_nor_writes(
    served: ServedPage, other: dict, order: dict, tmp_path: Path
) -> None:
    old = shown(served.order(drop=[50, 60])[1])
    state = served.order(old, **other)[1]
    status, answer = served.order(old, **order)
    assert status == 409
    assert "another page" in answer["error"]
    after = served.read("/state.json")
    assert {**after, "analysed": 0} == {**state, "analysed": 0}
    assert not (tmp_path / "lap_edited").exists()
    assert served.order(shown(after), **order)[0] == 200


def test_a_page_of_an_earlier_session_is_refused(served: ServedPage) -> None:
    state = served.read("/state.json")
    assert served.order(f"0{state['session']}.{state['changes']}", write=True)[0] == 409


def test_an_edit_that_changes_nothing_leaves_other_pages_as_they_are(served: ServedPage) -> None:
    old = shown(served.read("/state.json"))
    assert served.order(undo=True)[0] == 200
    assert served.order(drop=[10, 200])[0] == 400
    assert served.order(old, drop=[10, 20])[0] == 200


@pytest.mark.parametrize(
    ("command", "word"),
    [
        ({"drop": [10, 200]}, "1..120"),
        ({"drop": [1.5, 3]}, "drop"),
        ({"drop": "all"}, "drop"),
        ({"mirror": [True, 5]}, "mirror"),
        ({"split": "/etc"}, "split"),
        ({"split": 0}, "2..120"),
        ({"write": "/tmp/x", "drop": [1, 2]}, "one key"),
        ({"load": "/tmp/x"}, "one key"),
    ],
)
def test_a_wrong_command_is_refused(served: ServedPage, command: dict, word: str) -> None:
    status, answer = served.order(**command)
    assert status == 400
    assert word in answer["error"]
    assert served.read("/state.json")["undo"] == 0


@pytest.mark.parametrize(
    "headers",
    [{"Origin": "http://evil.example"}, {"Host": "evil.example"}, {"Content_Type": "text/plain"}],
)
def test_another_site_cannot_send_commands(served: ServedPage, headers: dict[str, str]) -> None:
    assert served.ask("POST", "/command", {"drop": [1, 2]}, **headers)[0] in (403, 415)
    assert served.read("/state.json")["undo"] == 0


@pytest.mark.parametrize("site", ["cross-site", "same-site"])
def test_another_site_can_link_to_the_page_and_no_more(served: ServedPage, site: str) -> None:
    """A browser sends these headers, and no Origin, for another site's image or link."""
    image = {"Sec_Fetch_Site": site, "Sec_Fetch_Mode": "no-cors"}
    link = {"Sec_Fetch_Site": site, "Sec_Fetch_Mode": "navigate"}
    for path in ("/image?row=7", "/recording.json", "/columns.bin", "/state.json", "/"):
        assert served.ask("GET", path, **image)[0] == 403
    assert served.ask("GET", "/state.json", **link)[0] == 403
    assert served.ask("GET", "/", **link)[0] == 200


POST = b"POST /command HTTP/1.1\r\nContent-Type: application/json\r\nContent-Length: 10\r\n\r\n"


def begin(port: int, sent: bytes) -> socket.socket:
    connection = socket.create_connection(("127.0.0.1", port), 20)
    connection.sendall(sent)
    return connection


def drip(connection: socket.socket) -> None:
    with contextlib.suppress(ConnectionError):
        for _ in range(1000):
            connection.sendall(b"x")
            time.sleep(0.02)
        pytest.fail("the server reads on")


def is_closed(connection: socket.socket) -> bool:
    """Return whether the server closes a connection without an answer."""
    try:
        return connection.recv(100) == b""
    except ConnectionError:
        return True


def test_a_command_that_never_arrives_is_refused(
    served: ServedPage, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture
) -> None:
    monkeypatch.setattr("zoo.base.page_server.PATIENCE_S", 0.2)
    with begin(served.port, POST) as connection:
        assert connection.recv(100).split()[1] == b"408"
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("sent", "status"),
    [
        (b"GET / HTTP/1.0\r\nSec-Fetch-Site: cross-site\r\n\r\n", b"403"),  # without a Host
        (POST.replace(b"10", b"9" * 5_000), b"413"),  # Python reads no such number
    ],
)
def test_a_strange_head_is_refused_without_a_traceback(
    sent: bytes, status: bytes, served: ServedPage, capfd: pytest.CaptureFixture
) -> None:
    with begin(served.port, sent) as connection:
        assert connection.recv(100).split()[1] == status
    assert "Traceback" not in capfd.readouterr().err


def test_a_dripping_request_is_closed(served: ServedPage, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each byte comes in time, and the whole request does not."""
    monkeypatch.setattr("zoo.base.page_server.PATIENCE_S", 0.2)
    with begin(served.port, b"GET / HTTP/1.1\r\nX: ") as connection:
        drip(connection)  # until the server closes it


def test_a_head_of_a_megabyte_is_not_kept(served: ServedPage) -> None:
    with begin(served.port, b"GET / HTTP/1.1\r\n") as connection:
        with contextlib.suppress(ConnectionError):
            for number in range(90):
                connection.sendall(b"X%d: " % number + b"y" * 12_000 + b"\r\n")
        assert is_closed(connection)


@pytest.mark.slow
def test_unfinished_requests_do_not_keep_others_out(served: ServedPage) -> None:
    held = [begin(served.port, b"GET / HT") for _ in range(MOST_REQUESTS + 2)]
    assert served.read("/state.json")
    assert is_closed(held[0])
    for client in held:
        client.close()


def test_written_recordings_load_under_different_names(served: ServedPage, tmp_path: Path) -> None:
    served.order(drop=[0, 100])
    for name in ("lap_edited", "lap_edited_2"):
        assert served.order(write="anywhere/else")[0] == 200, "the value is no path"
        served.page.session.finish()
        assert served.read("/state.json")["written"]["folders"] == [str(tmp_path / name)]
        assert len(read_recordings(str(tmp_path / name))) == 20


def drag(browser: Browser, selector: str, first: float, last: float) -> None:
    """Drag over an element, between two shares of its width."""
    box = browser.value(
        f"(() => {{ const b = document.querySelector('{selector}').getBoundingClientRect();"
        "return [b.x, b.y, b.width, b.height]; })()"
    )
    mouse = {"y": box[1] + box[3] / 2, "button": "left", "buttons": 1, "clickCount": 1}
    steps = [("mousePressed", first), ("mouseMoved", (first + last) / 2)]
    for kind, share in [*steps, ("mouseMoved", last), ("mouseReleased", last)]:
        browser.call("Input.dispatchMouseEvent", type=kind, x=box[0] + box[2] * share, **mouse)


@needs_chromium
def test_a_user_cleans_a_recording(served: ServedPage, tmp_path: Path) -> None:
    served.page.recording.steering[:] = 0
    wait_for_analysis(served)
    with Browser(tmp_path / "profile", 1400, 900) as browser:
        browser.open(served.url)
        browser.wait_for("document.documentElement.dataset.ready")
        browser.wait_for("document.querySelector('#center img').naturalWidth === 320")
        drag(browser, "#detail", 0.25, 0.5)
        browser.wait_for("document.querySelector('#selected').textContent.includes('31 to 6')")
        browser.click("#drop")
        browser.wait_for("document.querySelector('#kept').textContent.includes('of 120 rows')")
        browser.click("#undo")
        browser.wait_for("document.querySelector('#kept').textContent === '120 rows'")
        browser.click("#redo")
        browser.wait_for("document.querySelector('#kept').textContent.includes('of 120 rows')")
        browser.click("[data-kind=errors]")
        browser.wait_for("!!document.querySelector('#rows button')")
        browser.click("#rows button")
        browser.wait_for("!!document.querySelector('#rows [aria-current=true]')")
        browser.click("#write")
        browser.wait_for("document.querySelector('#confirm').open")
        browser.click("#confirm-write")
        browser.wait_for("!document.querySelector('#written').hidden")
        browser.click("#cancel")
        check_stale(browser, served)
        check_narrow(browser)
        check_typed_row(browser)
        check_playback(browser, served)
        noted = "fillText = (text) => (document.title += text)"
        browser.value(f"CanvasRenderingContext2D.prototype.{noted}, onresize()")
        browser.wait_for("/[+]0.[68] right/.test(document.title)")  # to hold the network's curve
        assert browser.errors == []
    assert 80 < len(read_recordings(str(tmp_path / "lap_edited"))) < 100


@needs_chromium
def test_a_row_is_dropped_for_damage_not_for_a_camera(served: ServedPage, tmp_path: Path) -> None:
    images = served.page.recording.images
    Path(images[3, 2]).unlink()
    images[3, 1] = None
    text = "document.querySelector('#{} p').textContent".format
    with Browser(tmp_path / "profile", 1400, 900) as browser:
        browser.open(f"{served.url}/#4")
        browser.wait_for(f"{text('right')}.includes('drop the row')")
        browser.wait_for(f"{text('left')}.includes('no image')")


def check_stale(browser: Browser, served: ServedPage) -> None:
    """Check that edits of another tab are shown in place of a writing that would have them."""
    rows = served.order(drop=[100, 110])[1]["parts"][0]
    browser.click("#write")
    browser.wait_for("document.querySelector('#confirm').open")
    browser.click("#confirm-write")
    browser.wait_for("!document.querySelector('#message').hidden")
    browser.wait_for(f"document.querySelector('#kept').textContent.startsWith('{rows} of')")
    assert served.read("/state.json")["finished"] == 1
    browser.click("#dismiss")
    browser.click("#undo")
    browser.wait_for(f"document.querySelector('#kept').textContent.startsWith('{rows + 10} of')")
    browser.errors = [error for error in browser.errors if "409" not in error]


def check_narrow(browser: Browser) -> None:
    """Check that nothing is wider than a phone, and that the largest image is the centre one."""
    sizes = {"width": 400, "height": 800, "deviceScaleFactor": 1, "mobile": False}
    browser.call("Emulation.setDeviceMetricsOverride", **sizes)
    browser.wait_for("document.documentElement.scrollWidth <= 400")
    width = "document.querySelector('#{}').clientWidth".format
    assert browser.value(width("center")) > 1.5 * browser.value(width("left"))


def check_typed_row(browser: Browser) -> None:
    """Check that a fraction is rounded to a row, and that an empty field shows the row again."""
    for typed in ("7.5", ""):
        browser.value(
            f"(() => {{ const field = document.querySelector('#row'); field.value = '{typed}';"
            "field.dispatchEvent(new Event('change')); })()"
        )
        browser.wait_for("document.querySelector('#row').value === '8'")
        browser.wait_for("document.querySelector('#center img').src.includes('row=7&')")


def check_playback(browser: Browser, served: ServedPage) -> None:
    """Check that playing skips dropped rows, and stops at the end."""
    served.order(drop=[5, 110])
    browser.open(served.url)
    browser.wait_for("document.querySelector('#kept').textContent.includes('15 of 120')")
    browser.click("#play")
    browser.wait_for("Number(document.querySelector('#row').value) > 110")
    browser.wait_for("document.querySelector('#play').textContent === 'Play'")

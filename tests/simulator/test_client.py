"""The autonomous mode: on the wire like the original, with real sockets."""

import contextlib
import json
import re
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
from rich.console import Console

from simulator.client import Client, ClientOptions, run_client
from simulator.errors import SimulatorError
from simulator.film import Film
from tests.simulator.drivers import RawDriver, steering_driver


def drive(driver: RawDriver, **options) -> tuple[Client, str]:
    """A client's drive, and what it told the person."""
    console = Console(record=True, width=300, quiet=False, file=open("/dev/null", "w"))  # noqa
    given = {"seconds": 0.6, "quality": "simple", **options}
    client = run_client(ClientOptions(url=driver.url, **given), console)
    return client, console.export_text()


@pytest.fixture(scope="module")
def talked() -> tuple[RawDriver, Client]:
    with RawDriver(steering_driver(throttle="1.0000")) as driver:
        client, _ = drive(driver)
    return driver, client


def test_the_handshake_is_a_websocket_that_says_eio_4(talked) -> None:
    request = talked[0].requests[0]
    assert request.startswith("GET /socket.io/?EIO=4&transport=websocket HTTP/1.1")
    assert "origin" not in request.lower()


def test_it_never_sends_the_connect_packet(talked) -> None:
    assert not any(text.startswith("40") for text in talked[0].messages[0])


def test_it_pings_at_once(talked) -> None:
    assert talked[0].messages[0][0] == "2"


def test_it_announces_itself_twice_and_then_answers_once_each(talked) -> None:
    """Two loops: telemetry is two more than the replies that were obeyed."""
    driver, client = talked
    telemetry = [text for text in driver.messages[0] if text.startswith('42["telemetry"')]
    # The last may be on its way when the client has driven enough.
    assert client.counts["telemetry"] - len(telemetry) in (0, 1)
    assert client.counts["telemetry"] == client.counts["steer"] + 2


def test_telemetry_comes_in_masked_fragments_of_1016_bytes(talked) -> None:
    frames = talked[0].frames[0]
    assert all(masked for _, _, masked, _ in frames)
    begin = next(i for i, (final, opcode, _, _) in enumerate(frames) if opcode == 1 and not final)
    end = next(i for i in range(begin, len(frames)) if frames[i][0])
    assert end - begin > 8
    assert [size for *_, size in frames[begin:end]] == [1016] * (end - begin)
    assert {opcode for _, opcode, _, _ in frames[begin + 1 : end + 1]} == {0}
    assert frames[end][3] <= 1016


def test_a_driver_that_accelerates_moves_the_car(talked) -> None:
    assert talked[1].world.car.speed_mph > 4


def test_a_replys_numbers_instead_of_strings_stall_it_as_the_original() -> None:
    def answer(text: str) -> list[str]:
        return ['42["steer",{"steering_angle":0.1,"throttle":0.2}]'] * text.startswith('42["tele')

    with RawDriver(answer) as driver:
        console = Console(record=True, width=300, file=open("/dev/null", "w"))  # noqa
        options = ClientOptions(url=driver.url, seconds=0.5, quality="simple")
        thread = threading.Thread(target=run_client, args=(options, console), daemon=True)
        thread.start()
        time.sleep(2)
        telemetry = [text for text in driver.messages[0] if "telemetry" in text]
        assert len(telemetry) == 1  # no OPEN packet, and no reply that it obeys
        assert "steering_angle is 0.1, expected a string" in console.export_text()


def test_a_servers_ping_is_answered() -> None:
    plain = steering_driver()

    def answer(text: str) -> list[str]:
        return [*plain(text), "2"] if text == "2" else plain(text)

    with RawDriver(answer) as driver:
        drive(driver)
        assert "3" in driver.messages[0]


def test_a_person_who_holds_w_sends_null_and_drives_on() -> None:
    with RawDriver(steering_driver(throttle="0.0000")) as driver:
        client, _ = drive(driver, manual=[[0.0, 0.4]])
        texts = [text for text in driver.messages[0] if "telemetry" in text]
    assert texts[0] == '42["telemetry",null]'
    assert texts[-1] != texts[0]
    assert client.counts["manual"] > 2
    assert client.world.car.speed_mph > 2


def test_a_decimal_comma_goes_both_ways() -> None:
    with RawDriver(steering_driver("0,0000", "1,0000")) as driver:
        client, _ = drive(driver, decimal_comma=True)
        telemetry = json.loads(driver.messages[0][1][2:])[1]
    assert re.fullmatch(r"\d+,\d{4}", telemetry["speed"])
    assert client.command == (0.0, 1.0)


def test_a_dropped_connection_is_made_again() -> None:
    with RawDriver(steering_driver()) as driver:
        client, said = drive(driver, drop_at=0.2)
        assert len(driver.requests) == 2
    assert client.counts["connections"] == 2
    assert "dropped, as asked" in said


def test_in_real_time_the_car_drives_on_between_replies() -> None:
    """A driver that answers nothing after its first reply: in lock step the world would stand."""
    replies = iter(['42["steer",{"steering_angle":"0.0","throttle":"1.0"}]'])

    def answer(text: str) -> list[str]:
        return list(replies) if "telemetry" in text else []

    with RawDriver(answer) as driver:
        began = time.monotonic()
        client, _ = drive(driver, clock="realtime", seconds=1.0)
    assert time.monotonic() - began > 0.9
    assert client.world.car.speed_mph > 8


def test_it_waits_for_a_driver_and_says_how_to_start_one() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    process = subprocess.Popen(
        [sys.executable, "-m", "simulator", "client", f"url=http://127.0.0.1:{port}"],
        stdout=subprocess.PIPE,
        text=True,
        cwd=Path(__file__).parents[2],
    )
    lines = [process.stdout.readline() for _ in range(2)]
    process.terminate()
    assert "waiting for a driver" in lines[1]
    assert "python -m zoo.drive CKPT" in lines[1]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"protocol": "old"}, "protocol=old: must be legacy or modern"),
        ({"clock": "slow"}, "clock=slow"),
        ({"manual": [[3.0, 1.0]]}, "manual: must be pairs"),
        ({"url": "nowhere"}, "url=nowhere: must be like http://127.0.0.1:4567"),
        ({"film": "lap.avi"}, "must end in .mp4"),
        ({"track": "lak"}, "there is no track lak"),
    ],
)
def test_an_option_that_cannot_be_is_named(options: dict, words: str) -> None:
    with pytest.raises(SimulatorError, match=re.escape(words)):
        run_client(ClientOptions(**{"seconds": 0.1, **options}), Console(quiet=True))


def test_a_film_is_h264_and_plays(tmp_path: Path) -> None:
    path = tmp_path / "films" / "lap.mp4"
    with Film(path, fps=20) as film:
        for grey in range(0, 200, 10):
            film.add(np.full((160, 320, 3), grey, np.uint8))
    data = path.read_bytes()
    assert b"avc1" in data
    assert data.index(b"moov") < data.index(b"mdat")  # the index first: it begins at once
    video = cv2.VideoCapture(str(path))
    frames = []
    while (read := video.read())[0]:
        frames.append(read[1])
    assert len(frames) == 20
    assert frames[0].shape == (160, 320, 3)
    assert abs(int(frames[-1].mean()) - 190) < 6
    assert not list(path.parent.glob(".*"))


def test_a_film_that_fails_leaves_the_one_before(tmp_path: Path) -> None:
    path = tmp_path / "lap.mp4"
    path.write_bytes(b"the one before")
    with contextlib.suppress(ZeroDivisionError), Film(path, fps=20) as film:
        film.add(np.zeros((16, 16, 3), np.uint8))
        raise ZeroDivisionError
    assert path.read_bytes() == b"the one before"
    assert list(tmp_path.iterdir()) == [path]


def test_a_film_without_a_frame_leaves_no_file(tmp_path: Path) -> None:
    with Film(tmp_path / "none.mp4", fps=20):
        pass
    assert not list(tmp_path.iterdir())

"""The Socket.IO client of 2016: its frames and messages, and its reactions to a server's."""

import base64
import re
import socket
import time
from collections.abc import Iterator
from contextlib import closing

import cv2
import numpy as np
import pytest

from tests.refusals import refusal
from tests.zoo.base.test_process_pool import wait_until
from tests.zoo.simulator.drivers import RawDriver, make_frame
from zoo.simulator import legacy_socket
from zoo.simulator.legacy_socket import OPENED, UNREADABLE, LegacySocket
from zoo.simulator.telemetry import make_telemetry, parse_float, read_steer

STEER = '42["steer",{"steering_angle":"0.0500","throttle":"0.2000"}]'
TELEMETRY = {"image": "A" * 16_800}  # 12.6 kB as base64


def listen(client: LegacySocket, wanted: int, patience_s: float = 2.0) -> list[tuple[str, object]]:
    """Return the first `wanted` events, or fewer if no more arrive in time."""
    events, end_s = [], time.monotonic() + patience_s
    while len(events) < wanted and time.monotonic() < end_s:
        events += client.events(0.02)
    return events


def answers_to_ping(*replies: str | bytes):
    """Return a driver's function that answers only the first ping, with these replies."""
    pending = [replies]
    return lambda text: pending.pop() if text == "2" and pending else []


def test_telemetry_is_17_fragments_or_so_of_1016_bytes_and_a_rest() -> None:
    with RawDriver(lambda _: []) as driver, closing(LegacySocket(driver.url)) as client:
        client.emit("telemetry", TELEMETRY)
        wait_until(lambda: len(driver.messages[0]) == 2)
    ping, *fragments = driver.frames[0]
    assert ping == (True, 1, True, 1)
    assert all(masked for _, _, masked, _ in fragments)
    assert [length for *_, length in fragments[:-1]] == [1016] * 16
    assert 0 < fragments[-1][3] <= 1016
    assert [opcode for _, opcode, _, _ in fragments] == [1] + [0] * 16
    assert [final for final, *_ in fragments] == [False] * 16 + [True]


def test_nagles_algorithm_is_on() -> None:
    with RawDriver(lambda _: []) as driver, closing(LegacySocket(driver.url)) as client:
        assert client._web.sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY) == 0


def test_it_pings_at_once_and_then_every_25_s(monkeypatch) -> None:
    assert legacy_socket.PING_EVERY_S == 25
    monkeypatch.setattr(legacy_socket, "PING_EVERY_S", 0.1)
    with RawDriver(lambda _: []) as driver, closing(LegacySocket(driver.url)) as client:
        listen(client, 1, patience_s=0.38)
    assert set(driver.messages[0]) == {"2"}
    assert 2 <= len(driver.messages[0]) <= 5  # a loaded machine sends fewer, none sends more


def test_a_modern_servers_packets_are_accepted() -> None:
    """CONNECT's answer, PONG, DISCONNECT, CLOSE and `maxPayload` are ignored."""
    opened = '0{"sid":"x","upgrades":[],"pingInterval":25000,"pingTimeout":2,"maxPayload":1000000}'
    replies = answers_to_ping(opened, '40{"sid":"x"}', "3", "41", "1", "2", STEER)
    with RawDriver(replies) as driver, closing(LegacySocket(driver.url)) as client:
        events = listen(client, 2)
        wait_until(lambda: len(driver.messages[0]) == 2)
    assert events == [(OPENED, None), ("steer", {"steering_angle": "0.0500", "throttle": "0.2000"})]
    assert driver.messages[0] == ["2", "3"]  # the server's ping, answered


@pytest.mark.parametrize(
    ("packet", "event"),
    [
        ('42["manual",{}]', ("manual", {})),
        ('42["manual"]', ("manual", None)),
        ('42["steer","0.1","0.2"]', ("steer", ("0.1", "0.2"))),
        ('42["steer",{"steering', (UNREADABLE, '42["steer",{"steering')),
        ("42[]", (UNREADABLE, "42[]")),
        ("427", (UNREADABLE, "427")),
    ],
)
def test_an_events_arguments(packet: str, event: tuple[str, object]) -> None:
    with RawDriver(answers_to_ping(packet)) as driver, closing(LegacySocket(driver.url)) as client:
        assert listen(client, 1) == [event]


def test_a_frame_that_arrives_in_two_halves_is_one_event() -> None:
    frame = make_frame(STEER)

    def halves(_: str) -> Iterator[bytes]:
        yield frame[:20]
        time.sleep(0.15)
        yield frame[20:]

    with RawDriver(halves) as driver, closing(LegacySocket(driver.url)) as client:
        assert [name for name, _ in listen(client, 1)] == ["steer"]


@pytest.mark.parametrize("goodbye", [b"\x88\x02\x03\xe8", None])
def test_a_driver_that_disconnects_is_a_connection_error(goodbye: bytes | None) -> None:
    """The driver sends a WebSocket's CLOSE, or only ends the TCP connection."""

    def answer(_: str) -> list[bytes]:
        if goodbye is None:
            raise EOFError
        return [goodbye]

    with (
        RawDriver(answer) as driver,
        closing(LegacySocket(driver.url)) as client,
        pytest.raises(ConnectionError),
    ):
        listen(client, 1)


def test_a_closed_port_is_an_os_error() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    with pytest.raises(OSError, match="refused"):
        LegacySocket(f"http://127.0.0.1:{port}")


@pytest.mark.parametrize("url", ["nowhere", "http://", "http://h:99999", "http://h:x", "ftp://h"])
def test_a_wrong_url_is_named(url: str) -> None:
    assert f"url={url}: must be like http://" in refusal(LegacySocket, url)


FRAME = np.full((160, 320, 3), (200, 100, 50), np.uint8)


@pytest.mark.parametrize("comma", [False, True])
def test_telemetry_is_strings_with_degrees_and_four_decimals_and_a_jpeg(comma: bool) -> None:
    message = make_telemetry(FRAME, -0.5, 0.25, 12.34567, comma, {"cte": -0.25})
    words = ["-12.5000", "0.2500", "12.3457", "-0.2500"]
    expected = [word.replace(".", ",") if comma else word for word in words]
    keys = ["steering_angle", "throttle", "speed", "cte"]
    assert list(message) == [*keys, "image"]
    assert [message[key] for key in keys] == expected
    data = np.frombuffer(base64.b64decode(message["image"]), np.uint8)
    image = cv2.cvtColor(cv2.imdecode(data, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)
    assert np.abs(image.astype(int) - FRAME).max() < 5


@pytest.mark.parametrize(
    ("text", "comma", "value"),
    [
        ("0.0500", False, 0.05),
        ("-1", False, -1.0),
        (" 1e-2 ", False, 0.01),
        (".5", False, 0.5),
        ("1,000", False, 1000.0),
        ("0,0500", True, 0.05),
        ("0.1000", True, 1000.0),  # the point separates thousands there
        ("0,05", False, 5.0),
        ("nan", False, None),
        ("", False, None),
        ("1.2.3", False, None),
        ("0x10", False, None),
        ("1e39", False, None),
    ],
)
def test_floats_are_parsed_as_csharp_parses_them(text, comma, value) -> None:
    assert parse_float(text, comma) == value


def test_a_steer_is_clamped() -> None:
    assert read_steer({"steering_angle": "-3.0", "throttle": "7"}, False) == (-1.0, 1.0)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({"steering_angle": 0.1, "throttle": "0.2"}, "steering_angle is 0.1, expected a string"),
        ({"steering_angle": "0.1"}, "it has no throttle"),
        ({"steering_angle": "nan", "throttle": "0"}, "float.Parse"),
        ([0.1, 0.2], "list, expected one object"),
        (None, "NoneType"),
    ],
)
def test_the_reason_for_discarding_a_reply_is_named(data: object, words: str) -> None:
    with pytest.raises(ValueError, match=re.escape(words)):
        read_steer(data, False)

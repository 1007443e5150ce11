"""Sessions and connections that are opened and left.

None of them blocks a simulator or stays in memory, and no message silences a session.
"""

import contextlib
import json
import socket
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest
import socketio

from tests.hostile.test_driver_http import ask
from tests.zoo.server.old_client import OldClient, check_drives, closed, telemetry
from tests.zoo.server.serve import FINE, NOTHING, RED, Served, served
from zoo.server.socketio_server import MOST_QUIET

HANDSHAKE = b"GET /socket.io/?EIO=4&transport=polling HTTP/1.1\r\nHost: 127.0.0.1\r\n%s\r\n"
TELEMETRY = json.dumps(["telemetry", telemetry(jpeg=RED)])


@pytest.fixture
def impatient(tmp_path: Path) -> Iterator[Served]:
    """Start a driver that waits half a second for a request's head and a session's telemetry."""
    with served(tmp_path / "drive", "tests.zoo.server.serve", str(tmp_path / "drive"), "0.5") as it:
        yield it


def poll(port: int, headers: bytes = b"") -> bytes:
    """Return the answer to a handshake of long polling."""
    return ask(port, HANDSHAKE % headers)


def hold(port: int, count: int, sent: bytes = b"GET / HT") -> list[socket.socket]:
    """Open connections that send the beginning of a request and then wait."""
    connections = []
    for _ in range(count):
        connections.append(socket.create_connection(("127.0.0.1", port), 10))
        with contextlib.suppress(OSError):
            connections[-1].sendall(sent)
    return connections


# --- Sessions that are opened and left ---


def test_polling_sessions_without_telemetry_are_freed(fresh: Served) -> None:
    with OldClient(fresh.port) as steady:
        for turn in range(4 * MOST_QUIET):
            assert b"200 OK" in poll(fresh.port)
            if turn % 50 == 0:
                steady.check_steered()
        steady.check_steered()
        sessions, tasks = fresh.held()
    assert sessions <= 2 * MOST_QUIET + 1, "engineio iterates over a copy of its table"
    assert tasks < 16, "no task per session"


def test_sessions_end_without_telemetry_and_leave_nothing(impatient: Served) -> None:
    quiet = [OldClient(impatient.port) for _ in range(20)]
    for _ in range(20):
        poll(impatient.port)
    with OldClient(impatient.port) as driving:
        driving.check_steered()
        for client in quiet:
            assert closed(client.socket)
        assert driving.silent_for(2)
        driving.check_steered()
    sessions, tasks = impatient.held()
    assert sessions <= 2, "the one that drives, and the last one, in a local variable"
    assert tasks < 16


@pytest.mark.slow
def test_a_current_client_is_driven_beyond_the_time_limit(impatient: Served) -> None:
    for transports in (["polling"], ["polling", "websocket"]):
        client = socketio.SimpleClient()
        client.connect(f"http://127.0.0.1:{impatient.port}", transports=transports)
        for _ in range(2):
            client.emit("telemetry", telemetry(jpeg=RED))
            assert client.receive(5)[0] == "steer"
            time.sleep(1.5)
        client.disconnect()


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        (b"", b"200"),
        (b"Sec-Fetch-Site: same-origin\r\n", b"200"),
        (b"Sec-Fetch-Site: none\r\n", b"200"),
        (b"Sec-Fetch-Site: cross-site\r\nSec-Fetch-Mode: no-cors\r\n", b"403"),
        (b"Sec-Fetch-Site: same-site\r\nSec-Fetch-Mode: no-cors\r\n", b"403"),
        (b"Sec-Fetch-Site: cross-site\r\nSec-Fetch-Mode: navigate\r\n", b"403"),
    ],
)
def test_another_sites_page_opens_no_session(driver: Served, headers: bytes, status: bytes) -> None:
    assert poll(driver.port, headers).split()[1] == status


# --- Connections that are held ---


def test_half_open_connections_block_no_simulator(fresh: Served) -> None:
    with OldClient(fresh.port) as steady:
        steady.check_steered()
        held = hold(fresh.port, 1_100)
        check_drives(fresh.port)
        steady.check_steered()
        assert closed(held[0]), "the oldest is closed first"
    for connection in held:
        connection.close()


def test_windows_waits_for_all_connections_at_a_time(monkeypatch) -> None:
    from zoo.server.server import CLOSING, _connection_limit

    monkeypatch.setitem(sys.modules, "resource", None)
    assert _connection_limit() + CLOSING < 512  # sockets that `select` takes there


def test_a_request_whose_head_never_ends_is_closed(impatient: Served) -> None:
    (connection,) = hold(impatient.port, 1)
    for _ in range(40):  # byte by byte, so that no single wait is long
        with contextlib.suppress(OSError):
            connection.sendall(b"x")
        time.sleep(0.1)
        if closed(connection, 0.01):
            return
    raise AssertionError("still open after 4 s")


# --- Messages that silence a session ---

GOOD_BINARY = json.dumps(["telemetry", telemetry(image={"_placeholder": True, "num": 0})])
FIRST = {
    "rubbish": (["4hello"], None),
    "no packet": (["4"], None),
    "an object": (["42{}"], None),
    "another namespace": (["40/other,"], None),
    "a binary message": ([b"\x00\x01"], None),
    "an event with an id": (["420" + TELEMETRY], FINE),
    "spaces": (['42 [ "telemetry", {}]'], NOTHING),
    "an id that is too long": (["42" + "9" * 200 + TELEMETRY], NOTHING),
    "a CONNECT with broken JSON": (['40{"token":'], None),
    "no attachment": (["450-" + TELEMETRY], NOTHING),
    "too many attachments": (["45999999999-" + TELEMETRY], NOTHING),
    "an attachment that never comes": (["451-" + GOOD_BINARY, "42" + TELEMETRY], NOTHING),
}


@pytest.mark.parametrize(("packets", "reply"), FIRST.values(), ids=FIRST)
def test_no_first_message_silences_a_session(driver: Served, packets: list, reply: object) -> None:
    with OldClient(driver.port) as client:
        for packet in packets:
            client.send_frame(2, packet) if isinstance(packet, bytes) else client.send(packet)
        if reply is not None:
            assert client.reply() == reply
        if len(packets) > 1:
            assert client.reply() == FINE
        client.telemetry(jpeg=RED)
        assert client.reply()[0] == "steer"
        assert client.silent_for(0.05)


@pytest.mark.parametrize("number", [1, -5, "x", None, 1e9])
def test_a_bad_placeholder_is_answered_and_forgotten(driver: Served, number: object) -> None:
    event = json.dumps(["telemetry", telemetry(image={"_placeholder": True, "num": number})])
    with OldClient(driver.port) as client:
        client.send("451-" + event)
        client.send_frame(2, RED)
        assert client.reply() == NOTHING
        client.check_steered()
        client.send("451-" + GOOD_BINARY)
        client.send_frame(2, RED)
        assert client.reply() == FINE


def test_an_attachment_beyond_the_limit_is_answered(driver: Served) -> None:
    with OldClient(driver.port, timeout_s=10) as client:
        client.send("451-" + GOOD_BINARY)
        client.send_frame(2, bytes(5_000_000))
        assert float(client.reply()[1]["steering_angle"]) == 0
        client.check_steered()


def test_an_invalid_packet_ends_the_session(fresh: Served) -> None:
    for packet in ("", "x", "bA"):
        with OldClient(fresh.port) as client:
            client.send(packet)
            assert closed(client.socket)
    time.sleep(0.2)
    assert fresh.held()[0] <= 1, "the last one, in a local variable"


@pytest.mark.parametrize("auth", [{"token": "x"}, {}, ["x"], "x"])
@pytest.mark.parametrize("transports", [["polling", "websocket"], ["websocket"]])
def test_a_client_with_auth_is_driven(driver: Served, auth: object, transports: list[str]) -> None:
    client = socketio.SimpleClient()
    client.connect(f"http://127.0.0.1:{driver.port}", auth=auth, transports=transports)
    client.emit("telemetry", telemetry(jpeg=RED))
    assert tuple(client.receive(5)) == FINE
    client.disconnect()


@pytest.mark.slow
def test_memory_does_not_grow_with_handshakes(fresh: Served) -> None:
    process = psutil.Process(fresh.process.pid)
    for _ in range(500):
        poll(fresh.port)
    before = process.memory_info().rss
    ends = time.monotonic() + 30
    for _ in range(10_000):
        poll(fresh.port)
        if time.monotonic() > ends:
            break
    assert process.memory_info().rss - before < 30 << 20
    check_drives(fresh.port)

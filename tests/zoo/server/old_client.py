"""The original simulator's client, as it is on the wire: Engine.IO 3 that calls itself 4.

It never asks to be connected, it PINGs, and it sends masked fragments of 1016 bytes with Nagle's
algorithm on.
"""

import base64
import json
import os
import socket
import time

from websocket import ABNF

from tests.zoo.server.serve import FINE, RED

FRAGMENT = 1016
CONTINUATION, TEXT, CLOSE, WS_PING = 0, 1, 8, 9
REQUEST = (
    "GET /socket.io/?EIO=4&transport=websocket HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n"
    "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Key: {key}\r\n"
    "Sec-WebSocket-Version: 13\r\n{more}\r\n"
)


class OldClient:
    """A connection to a driver; use it in a `with`.

    Args:
        port: on this machine.
        headers: more lines of the handshake.
        timeout_s: of everything that waits; a driver that is silent for so long has failed.

    Attributes:
        status: of the handshake, 101 where all is well.
        packets: all Engine.IO packets received, in order.
    """

    def __init__(self, port: int, headers: str = "", timeout_s: float = 5.0) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), timeout_s)
        self.packets: list[str] = []
        self._ahead = b""
        key = base64.b64encode(os.urandom(16)).decode()
        self.socket.sendall(REQUEST.format(port=port, key=key, more=headers).encode())
        while b"\r\n\r\n" not in self._ahead:
            self._ahead += self._receive()
        head, _, self._ahead = self._ahead.partition(b"\r\n\r\n")
        self.status = int(head.split()[1])

    def __enter__(self) -> "OldClient":
        return self

    def __exit__(self, *error: object) -> None:
        self.socket.close()

    def send(self, packet: str | bytes) -> None:
        """Send an Engine.IO packet in fragments, each by its own write."""
        data = packet.encode() if isinstance(packet, str) else packet
        starts = range(0, max(len(data), 1), FRAGMENT)
        for start in starts:
            first, last = start == 0, start == starts[-1]
            self.send_frame(TEXT if first else CONTINUATION, data[start : start + FRAGMENT], last)

    def send_frame(self, opcode: int, payload: bytes, last: bool = True) -> None:
        self.socket.sendall(masked_frame(opcode, payload, last))

    def emit(self, name: str, *arguments: object) -> None:
        self.send("42" + json.dumps([name, *arguments]))

    def telemetry(self, **values: object) -> None:
        """Send one telemetry message of a standing car; see `telemetry`."""
        self.emit("telemetry", telemetry(**values))

    def check_steered(self, **values: object) -> None:
        """Send an image, and check the reply."""
        self.telemetry(jpeg=RED, **values)
        assert self.reply() == FINE, "a session that drives stays open"

    def packet(self, timeout_s: float | None = None) -> str:
        """Return the next Engine.IO packet; answer a PING, as the original does, and go on reading.

        Raises:
            TimeoutError: no packet arrives.
            ConnectionError: the driver has disconnected.
        """
        if timeout_s is not None:
            self.socket.settimeout(timeout_s)
        while True:
            opcode, payload = self._frame()
            if opcode == CLOSE:
                raise ConnectionError("closed")
            packet = payload.decode()
            self.packets.append(packet)
            if packet != "2":
                return packet
            self.send("3")

    def reply(self, timeout_s: float | None = None) -> tuple[str, object]:
        """Return the next event and its only argument; skip other packets."""
        while True:
            packet = self.packet(timeout_s)
            if packet.startswith("42"):
                name, *arguments = json.loads(packet[2:])
                assert len(arguments) == 1, packet
                return name, arguments[0]

    def silent_for(self, seconds: float) -> bool:
        """Return whether no event arrives for some seconds."""
        end_s, usual = time.perf_counter() + seconds, self.socket.gettimeout()
        try:
            while (left_s := end_s - time.perf_counter()) > 0:
                if self.packet(left_s).startswith("42"):
                    return False
        except TimeoutError:
            pass
        finally:
            self.socket.settimeout(usual)
        return True

    def _frame(self) -> tuple[int, bytes]:
        head = self._exactly(2)
        size = head[1] & 127
        if size == 126:
            size = int.from_bytes(self._exactly(2), "big")
        return head[0] & 15, self._exactly(size)

    def _exactly(self, size: int) -> bytes:
        while len(self._ahead) < size:
            self._ahead += self._receive()
        data, self._ahead = self._ahead[:size], self._ahead[size:]
        return data

    def _receive(self) -> bytes:
        data = self.socket.recv(1 << 16)
        if not data:
            raise ConnectionError("the driver has hung up")
        return data


def check_drives(port: int) -> None:
    """Check that a driver steers a client that has just connected."""
    with OldClient(port) as client:
        client.check_steered()


def closed(connection: socket.socket, timeout_s: float = 5) -> bool:
    """Return whether the driver closes a connection."""
    connection.settimeout(timeout_s)
    try:
        while connection.recv(4096):
            pass
    except TimeoutError:
        return False
    except OSError:
        pass
    return True


def masked_frame(opcode: int, payload: bytes, last: bool = True) -> bytes:
    """Return a WebSocket frame, as clients send it."""
    return ABNF.create_frame(payload, opcode, int(last)).format()


def telemetry(jpeg: bytes = b"", decimal: str = ".", **values: object) -> dict:
    """Return the argument of a telemetry event; `values` replace its own, None removes one."""
    numbers = {"steering_angle": "0.0000", "throttle": "0.0000", "speed": "0.0000"}
    message = {name: text.replace(".", decimal) for name, text in numbers.items()}
    message["image"] = base64.b64encode(jpeg).decode()
    message |= values
    return {name: value for name, value in message.items() if value is not None}

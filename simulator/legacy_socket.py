"""The socket of the original's autonomous mode: a Socket.IO client of 2016, byte for byte.

It asks for `EIO=4` and speaks Engine.IO 3: it never sends the CONNECT packet, it pings by itself,
and it announces itself twice. A driver that serves this one serves the original.
"""

import json
import socket
import ssl
import time
from urllib.parse import urlsplit

import websocket

from simulator.errors import SimulatorError

FRAGMENT_BYTES = 1016
PING_EVERY_S = 25.0
OPENED = "opened"  # what `events` yields for the Engine.IO OPEN packet


class LegacySocket:
    """A WebSocket straight to `/socket.io/`.

    Args:
        url: of the driver, `http://127.0.0.1:4567`.

    Raises:
        SimulatorError: a URL that is none.
        OSError: nobody listens there, or the handshake is refused.
    """

    def __init__(self, url: str) -> None:
        parts = urlsplit(url)
        if parts.scheme not in ("http", "https", "ws", "wss") or not parts.hostname:
            raise SimulatorError(f"url={url}: must be like http://127.0.0.1:4567")
        scheme = "wss" if parts.scheme in ("https", "wss") else "ws"
        address = f"{scheme}://{parts.netloc}/socket.io/?EIO=4&transport=websocket"
        try:
            # No Origin: the original sends none, and a driver may refuse strangers' pages by it.
            self._web = websocket.create_connection(address, timeout=5, suppress_origin=True)
        except (websocket.WebSocketException, ssl.SSLError) as error:
            raise ConnectionError(str(error)) from None
        # The original leaves Nagle's algorithm on, which meets the server's delayed ACK.
        self._web.sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 0)
        self._web.settimeout(0.001)
        self._text("2")
        self._pinged = time.monotonic()

    def emit(self, name: str, data: object) -> None:
        """Send an event of the default namespace."""
        self._text("42" + json.dumps([name, data], separators=(",", ":")))

    def events(self, wait_s: float) -> list[tuple[str, object]]:
        """What came within `wait_s` seconds, as (name, argument); returns with the first.

        Raises:
            ConnectionError: the driver closed the connection.
        """
        if time.monotonic() - self._pinged > PING_EVERY_S:
            self._text("2")
            self._pinged = time.monotonic()
        self._web.settimeout(max(wait_s, 0.0005))
        try:
            packet = self._web.recv()
        except (websocket.WebSocketTimeoutException, BlockingIOError):
            return []
        except (websocket.WebSocketException, OSError) as error:
            raise ConnectionError(str(error)) from None
        if isinstance(packet, bytes):
            return []
        return self._understand(packet)

    def close(self) -> None:
        """Drop the connection, as a car that is switched off does."""
        self._web.shutdown()

    def _understand(self, packet: str) -> list[tuple[str, object]]:
        if packet.startswith("0"):
            return [(OPENED, None)]
        if packet == "2":
            self._text("3")
        elif packet.startswith("1"):
            raise ConnectionError("the driver closed the session")
        elif packet.startswith("42"):
            try:
                name, *rest = json.loads(packet[2:])
            except (ValueError, TypeError):
                return []
            return [(str(name), rest[0] if rest else None)]
        return []  # PONG, the CONNECT packet's answer, and a DISCONNECT that it never minds

    def _text(self, text: str) -> None:
        """Send in masked fragments of 1016 bytes and a rest."""
        data = text.encode()
        pieces = [data[at : at + FRAGMENT_BYTES] for at in range(0, len(data), FRAGMENT_BYTES)]
        self._web.settimeout(30)
        try:
            for number, piece in enumerate(pieces):
                kind = websocket.ABNF.OPCODE_TEXT if number == 0 else websocket.ABNF.OPCODE_CONT
                last = int(number == len(pieces) - 1)
                self._web.send_frame(websocket.ABNF(last, 0, 0, 0, kind, 1, piece))
        except (websocket.WebSocketException, OSError) as error:
            raise ConnectionError(str(error)) from None

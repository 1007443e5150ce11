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

from simulator.bounded_socket import HANDSHAKE_S, BoundedWebSocket
from simulator.errors import SimulatorError

FRAGMENT_BYTES = 1016
PING_EVERY_S = 25.0
OPENED = "opened"  # what `events` yields for the Engine.IO OPEN packet
UNREADABLE = "unreadable"  # and for an event that is no JSON array with a name, with its text


class HandshakeRefusedError(ConnectionError):
    """Something listens there and answers, but not with a WebSocket; the text is `HTTP 400`."""


def websocket_address(url: str) -> str:
    """Where the original connects to, for a driver's `http://127.0.0.1:4567`.

    Raises:
        SimulatorError: a URL that is none.
    """
    parts = urlsplit(url)
    try:
        whole = parts.hostname and parts.port != 0  # a port that is no number raises
    except ValueError:
        whole = False
    if parts.scheme not in ("http", "https", "ws", "wss") or not whole:
        raise SimulatorError(f"url={url}: must be like http://127.0.0.1:4567")
    scheme = "wss" if parts.scheme in ("https", "wss") else "ws"
    return f"{scheme}://{parts.netloc}/socket.io/?EIO=4&transport=websocket"


class LegacySocket:
    """A WebSocket straight to `/socket.io/`.

    Args:
        url: of the driver, `http://127.0.0.1:4567`.

    Raises:
        SimulatorError: a URL that is none.
        OSError: nobody listens there, or the handshake is refused or not answered.
    """

    def __init__(self, url: str) -> None:
        address = websocket_address(url)
        try:
            # No Origin: the original sends none, and a driver may refuse strangers' pages by it.
            self._web = websocket.create_connection(
                address, timeout=HANDSHAKE_S, class_=BoundedWebSocket, suppress_origin=True
            )
        except websocket.WebSocketBadStatusException as error:
            raise HandshakeRefusedError(f"HTTP {error.status_code}") from None
        except (websocket.WebSocketException, ssl.SSLError) as error:
            raise ConnectionError(str(error)) from None
        # The original leaves Nagle's algorithm on, which meets the server's delayed ACK.
        self._web.sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 0)
        self._pinged = time.monotonic()
        try:
            self._text("2")
        except ConnectionError:
            self.close()
            raise

    def emit(self, name: str, data: object) -> None:
        """Send an event of the default namespace."""
        self._text("42" + json.dumps([name, data], separators=(",", ":")))

    def events(self, wait_s: float) -> list[tuple[str, object]]:
        """What came within `wait_s` seconds, as (name, argument); returns with the first.

        The argument is None where an event has none, and a tuple of them where it has several.

        Raises:
            ConnectionError: the driver closed the connection.
        """
        if time.monotonic() - self._pinged > PING_EVERY_S:
            self._text("2")
            self._pinged = time.monotonic()
        self._web.settimeout(max(wait_s, 0.0005))
        try:
            kind, data = self._web.recv_data()  # half a frame is kept for the next call
        except (websocket.WebSocketTimeoutException, BlockingIOError):
            return []
        except (websocket.WebSocketException, OSError) as error:
            raise ConnectionError(str(error)) from None
        if kind == websocket.ABNF.OPCODE_CLOSE:
            raise ConnectionError("the driver closed it")
        return self._understand(data.decode()) if kind == websocket.ABNF.OPCODE_TEXT else []

    def close(self) -> None:
        """Drop the connection, as a car that is switched off does."""
        self._web.shutdown()

    def _understand(self, packet: str) -> list[tuple[str, object]]:
        if packet.startswith("0"):
            return [(OPENED, None)]
        if packet == "2":
            self._text("3")
        elif packet.startswith("42"):
            try:
                name, *rest = json.loads(packet[2:])
            except (ValueError, TypeError):
                return [(UNREADABLE, packet)]
            if len(rest) > 1:
                return [(str(name), tuple(rest))]
            return [(str(name), rest[0] if rest else None)]
        # PONG, the CONNECT packet's answer, and what it never minds: a DISCONNECT, and the CLOSE of
        # a session, after which a driver closes the connection too.
        return []

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

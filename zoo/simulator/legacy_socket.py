"""The original's Socket.IO client of 2016, byte for byte, with limits for untrusted servers.

It requests `EIO=4` but follows Engine.IO 3: it never sends the CONNECT packet, it sends pings
itself, and it sends telemetry twice at the start. A driver that works with this client works with
the original one.
"""

import contextlib
import json
import math
import socket
import ssl
import threading
import time
from collections.abc import Sequence
from typing import Any
from urllib.parse import urlsplit

import websocket
from websocket._abnf import continuous_frame, frame_buffer

from zoo.base.errors import InputError

MAX_MESSAGE = 1 << 20  # bytes of one frame and of one message; a driver's reply has about 60
HANDSHAKE_S = 5.0  # seconds for the whole answer to a handshake
_GRACE_S = 0.1  # extra seconds for data that has arrived already
FRAGMENT_BYTES = 1016
PING_EVERY_S = 25.0
OPENED = "opened"  # event for the Engine.IO OPEN packet
UNREADABLE = "unreadable"  # event for a message that is not a JSON array with a name


class HandshakeSilentError(ConnectionError):
    """A server that accepts connections but does not answer the handshake."""


class _Frames(frame_buffer):
    def recv_length(self) -> None:
        super().recv_length()
        _check(self.length or 0)


class _Message(continuous_frame):
    def add(self, frame: websocket.ABNF) -> None:
        super().add(frame)
        _check(len(self.cont_data[1]) if self.cont_data else 0)


class BoundedWebSocket(websocket.WebSocket):
    """websocket-client's WebSocket, with limits on a message and on a handshake.

    The timeout covers a whole message. In the library it restarts with each byte, so that a server
    that sends byte by byte never reaches it.
    """

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.frame_buffer = _Frames(self._recv, self.frame_buffer.skip_utf8_validation)
        self.cont_frame = _Message(
            self.cont_frame.fire_cont_frame, self.cont_frame.skip_utf8_validation
        )
        self._until_s = math.inf

    def connect(self, url: str, **options: object) -> None:
        """Connect and complete the handshake.

        Raises:
            HandshakeSilentError: the server did not answer within `HANDSHAKE_S`.
        """
        late = threading.Event()

        def give_up() -> None:
            if self.sock is not None:  # None while TCP still connects
                late.set()
                with contextlib.suppress(OSError):
                    self.sock.shutdown(socket.SHUT_RDWR)

        timer = threading.Timer(HANDSHAKE_S, give_up)
        timer.daemon = True
        timer.start()
        try:
            super().connect(url, **options)
        except Exception as error:
            if late.is_set() or isinstance(error, websocket.WebSocketTimeoutException):
                reason = f"no answer to the handshake in {HANDSHAKE_S:.0f} s"
                raise HandshakeSilentError(reason) from None
            raise
        finally:
            timer.cancel()

    def recv_data(self, control_frame: bool = False) -> tuple:
        """Return the next message's opcode and bytes; keep an incomplete one for the next call."""
        timeout_s = self.gettimeout()
        self._until_s = math.inf if timeout_s is None else time.monotonic() + timeout_s + _GRACE_S
        return super().recv_data(control_frame)

    def close(self, *_arguments: object, **_options: object) -> None:
        """Close the connection without waiting for the server, for which the library waits."""
        if self.sock is not None:
            with contextlib.suppress(OSError, websocket.WebSocketException):
                self.sock.settimeout(_GRACE_S)
                if self.connected:
                    self.send_close()
            with contextlib.suppress(OSError):
                self.sock.shutdown(socket.SHUT_RDWR)  # ends a thread that is reading
        self.shutdown()

    def _recv(self, bufsize: int) -> bytes:
        if time.monotonic() > self._until_s:
            raise websocket.WebSocketTimeoutException("the message took too long")
        return super()._recv(bufsize)


def _check(size: int) -> None:
    if size > MAX_MESSAGE:
        raise websocket.WebSocketPayloadException(
            f"the driver sent a message of {size:,} bytes; the limit is {MAX_MESSAGE:,}"
        )


def websocket_address(url: str) -> str:
    """Return the address that the original connects to for a driver's `http://127.0.0.1:4567`.

    Raises:
        InputError: the URL has no host, a wrong port or another scheme.
    """
    parts = urlsplit(url)
    try:
        complete = parts.hostname and parts.port != 0  # a port that is not a number raises
    except ValueError:
        complete = False
    if parts.scheme not in ("http", "https", "ws", "wss") or not complete:
        raise InputError(f"url={url}: must be like http://127.0.0.1:4567")
    scheme = "wss" if parts.scheme in ("https", "wss") else "ws"
    return f"{scheme}://{parts.netloc}/socket.io/?EIO=4&transport=websocket"


def argument_of(arguments: Sequence[object]) -> object:
    """Return an event's argument: None for an event without arguments, a tuple for several."""
    return tuple(arguments) if len(arguments) > 1 else next(iter(arguments), None)


class LegacySocket:
    """A WebSocket connection to a driver's `/socket.io/`, without polling before it.

    Args:
        url: address of the driver, such as `http://127.0.0.1:4567`.

    Raises:
        InputError: the URL is not an address of a driver.
        OSError: no server listens there, or it refuses or does not answer the handshake.
    """

    def __init__(self, url: str) -> None:
        address = websocket_address(url)
        try:
            # No Origin: the original sends none, and a driver may refuse other sites' pages by it.
            self._web = websocket.create_connection(
                address,
                timeout=HANDSHAKE_S,
                # The original leaves Nagle's algorithm on, which waits for the server's late ACK.
                sockopt=[(socket.IPPROTO_TCP, socket.TCP_NODELAY, 0)],
                class_=BoundedWebSocket,
                suppress_origin=True,
            )
        except websocket.WebSocketBadStatusException as error:
            raise ConnectionError(f"HTTP {error.status_code}") from None
        except (websocket.WebSocketException, ssl.SSLError) as error:
            raise ConnectionError(str(error)) from None
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
        """Return the events received within `wait_s` seconds, or as soon as one arrives.

        Each event is (name, argument); see `argument_of`.

        Raises:
            ConnectionError: the driver closed the connection.
        """
        if time.monotonic() - self._pinged > PING_EVERY_S:
            self._text("2")
            self._pinged = time.monotonic()
        self._web.settimeout(max(wait_s, 0.0005))
        try:
            kind, data = self._web.recv_data()  # an incomplete frame is kept for the next call
        except (websocket.WebSocketTimeoutException, BlockingIOError):
            return []
        except (websocket.WebSocketException, OSError) as error:
            raise ConnectionError(str(error)) from None
        if kind == websocket.ABNF.OPCODE_CLOSE:
            raise ConnectionError("the driver closed the connection")
        return self._parse_packet(data.decode()) if kind == websocket.ABNF.OPCODE_TEXT else []

    def close(self) -> None:
        """Close the connection without a CLOSE packet, as the original does."""
        self._web.shutdown()

    def _parse_packet(self, packet: str) -> list[tuple[str, object]]:
        if packet.startswith("0"):
            return [(OPENED, None)]
        if packet == "2":
            self._text("3")
        elif packet.startswith("42"):
            try:
                name, *rest = json.loads(packet[2:])
            except (ValueError, TypeError):
                return [(UNREADABLE, packet)]
            return [(str(name), argument_of(rest))]
        # The original ignores PONG, the answer to CONNECT, DISCONNECT, and the CLOSE of a session,
        # after which a driver closes the connection anyway.
        return []

    def _text(self, text: str) -> None:
        """Send a text in masked fragments of at most 1016 bytes."""
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

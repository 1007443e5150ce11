"""WebSockets that are fast enough for 60 frames per second, and bounded in memory.

eventlet's own WebSocket takes 5 to 11 ms per camera image: it unmasks the message byte by byte, and
the kernel delays the acknowledgements that the many small fragments of the original client wait
for.
"""

import contextlib
import functools
import json
import re
import select
import socket
import sys
import time
from collections.abc import Callable
from types import MethodType

import eventlet
from engineio import Server
from engineio.socket import Socket
from eventlet.greenio import GreenSocket
from eventlet.websocket import ConnectionClosedError, RFC6455WebSocket, WebSocketWSGI

MAX_MESSAGE = 2 << 20  # bytes; the largest allowed image, 1 MB, takes 1.33 MB in base64
ENVIRON_KEY = "drivezoo.websocket"  # key of a session's WebSocket in its environ
HOLD_KEY = "drivezoo.hold"  # key of the function that counts the bytes that a WebSocket holds
FLOOD_KEY = "drivezoo.flood"  # key of the function that closes a connection that floods
COPIES = 3  # copies of a message during its answer: eventlet's, engineio's and the JSON's

BINARY = 2  # the opcode

_TELEMETRY = re.compile(rb'42\d*\s*\[\s*"telemetry"')
_READ = 1 << 16
SMALL_FRAME = 512  # bytes; below, a frame takes as long to read as an empty one
# Small frames in a second. A telemetry has one or two; two loops at 60 fps send 120 a second.
MOST_SMALL = 2000
SMALL_TURN = 32  # small frames of a message that are read before other clients run

_SMALL = 4096  # characters; eventlet and engineio may keep a shorter message until the next
_QUICKACK = getattr(socket, "TCP_QUICKACK", None)  # exists, and is needed, only on Linux


class EagerSocket:
    """Green socket that reads ahead, and acknowledges received bytes at once.

    Args:
        sock: connection to the client.
        hold: function that counts the bytes of the unfinished message; it may wait.
    """

    def __init__(self, sock: GreenSocket, hold: Callable[[int], None]) -> None:
        self._sock, self._ahead = sock, memoryview(b"")
        self._hold, self._unfinished = hold, 0
        self._hung_up = False
        # Send each reply at once, without waiting for the client's acknowledgement of the last.
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def recv(self, size: int) -> bytes:
        """Return at most `size` bytes; none if the client has closed the connection."""
        if self._hung_up:
            return b""
        if not self._ahead:
            self._ahead = memoryview(self._sock.recv(_READ))
            if len(self._ahead) > _READ // 2:  # more waits, which would never give way
                eventlet.sleep(0)
            if _QUICKACK is not None and self._ahead:
                # Set again after each read, since the kernel resets it. Otherwise the kernel delays
                # the acknowledgement by 40 ms, and the client's Nagle algorithm waits for it.
                self._sock.setsockopt(socket.IPPROTO_TCP, _QUICKACK, 1)
            self._unfinished = min(self._unfinished + len(self._ahead), MAX_MESSAGE)
            self._hold(self._unfinished)
            if self._hung_up:  # while it waited
                self._ahead = self._ahead[:0]
                return b""
        taken, self._ahead = self._ahead[:size], self._ahead[size:]
        return bytes(taken)

    def finished(self, size: int) -> None:
        """Count `size` bytes for the message that is now complete."""
        self._unfinished = 0
        self._hold(size)

    def hang_up(self) -> None:
        """Close the connection now, and drop the bytes that were not read."""
        self._hung_up = True
        with contextlib.suppress(OSError):  # the client may have closed it first
            self._sock.shutdown(socket.SHUT_RDWR)

    def __getattr__(self, name: str) -> object:
        return getattr(self._sock, name)


class FastWebSocket(RFC6455WebSocket):
    """eventlet's WebSocket with six changes.

    It reads ahead, unmasks a message in one operation, answers the Engine.IO PING of the clients of
    2016, drops bytes above `MAX_MESSAGE` on arrival, and frees a large message after its answer. It
    lets other clients run after every message, and ends a flood of small frames.

    Attributes:
        received_s: time at which the last message had arrived, by `time.perf_counter`.
        sent_s: time at which the last message had been sent.
    """

    received_s = sent_s = 0.0

    def __init__(self, sock: GreenSocket, environ: dict, version: int) -> None:
        # Accept frames of any length; `Message` drops the bytes above the limit.
        hold = environ.get(HOLD_KEY, lambda size: None)
        super().__init__(EagerSocket(sock, hold), environ, version, max_frame_length=1 << 62)
        environ[ENVIRON_KEY] = self
        self._flood = environ.get(FLOOD_KEY, self.hang_up)
        self._small, self._counted_s = 0, time.monotonic()
        self._large = False  # whether the last message was large
        self._takes = _readiness(sock)

    class Message(RFC6455WebSocket.Message):
        """A message that keeps only its beginning once it is too long."""

        size = 0

        def push(self, data: bytes, final: bool = False) -> None:
            """Append a fragment."""
            self.finished = final
            self.size += len(data)
            if not self.data:  # one object, since a fragment of one byte takes 42 bytes
                self.data = [bytearray()]
            if self.size <= MAX_MESSAGE:
                self.data[0] += data
            else:
                del self.data[0][64:]

        def getvalue(self) -> bytes | str:
            """Return the message; for one that is too long, a short replacement."""
            if self.size <= MAX_MESSAGE:
                return super().getvalue()
            # A telemetry that is too long is still answered, since the client waits for a reply.
            if self.opcode == BINARY:
                return b""
            begins_so = _TELEMETRY.match(self.data[0][:64])
            return f'42["telemetry","{self.size} bytes"]' if begins_so else "6"

    class UTF8Decoder:
        """Decoder that replaces bytes that are no UTF-8, and keeps the connection."""

        def decode(self, data: bytes, final: bool = False) -> str:
            """Return the text of a message."""
            return data.decode("utf-8", "replace")

    def _get_bytes(self, numbytes: int) -> bytes:
        data = self.socket.recv(numbytes)
        while len(data) < numbytes:
            more = self.socket.recv(numbytes - len(data))
            if not more:
                raise ConnectionClosedError
            data += more
        return data

    def _recv_frame(self, message: Message | None = None) -> Message:
        before = message.size if message else 0
        received = super()._recv_frame(message)
        if received.size - (before if received is message else 0) < SMALL_FRAME:
            self._count_small()
        return received

    def _count_small(self) -> None:
        """Let other clients run now and then; close the connection after too many in a second."""
        self._small += 1
        if self._small % SMALL_TURN == 0:
            eventlet.sleep(0)
        if self._small == MOST_SMALL:
            now_s = time.monotonic()
            if now_s - self._counted_s < 1:
                self._flood()
            self._small, self._counted_s = 0, now_s

    @staticmethod
    def _apply_mask(
        data: bytes, mask: tuple[int, ...], length: int | None = None, offset: int = 0
    ) -> bytes:
        size, turn = len(data), offset % 4
        key = bytes(mask[turn:] + mask[:turn]) * (size // 4 + 1)
        number = int.from_bytes(data, "little") ^ int.from_bytes(key[:size], "little")
        return number.to_bytes(size, "little")

    def wait(self) -> str | bytes | None:
        """Return the next message; None once the connection is closed. Answer PINGs meanwhile."""
        if self._large:
            # engineio and eventlet keep the last message until the next: replace it by a short one.
            self._large = False
            self.iterator = self._iter_frames()
            return "6"
        self.socket.finished(0)
        while True:
            eventlet.sleep(0)  # let other clients and the page run, however fast this one sends
            message = super().wait()
            # In Engine.IO 4 only the server sends PINGs, so that engineio rejects a client's "2".
            # "2probe" belongs to the change from polling to a WebSocket.
            if message != "2":
                self.received_s = time.perf_counter()
                self._large = message is not None and len(message) > _SMALL
                self.socket.finished(COPIES * sys.getsizeof(message) if self._large else 0)
                return message
            self.send("3")

    def send(self, message: str | bytes, **more: object) -> None:
        """Send a message and note the time."""
        super().send(message, **more)
        self.sent_s = time.perf_counter()

    def send_event(self, name: str, argument: dict) -> bool:
        """Send an event of Socket.IO's default namespace from the calling task, without waiting.

        Returns:
            False if the system does not accept it at once; then nothing is sent.
        """
        try:
            if self._sendlock.locked() or not self._takes():
                return False
            self.send(f"42{json.dumps([name, argument], separators=(',', ':'))}")
        except OSError:  # disconnected; the reader notices it, too
            return False
        return True

    def close(self, close_data: tuple[int, str] | None = None) -> None:
        """Close the connection as eventlet does, but print nothing if the client was first."""
        with contextlib.suppress(OSError):
            self._send_closing_frame(ignore_send_errors=True, close_data=close_data)
            self.socket.shutdown(socket.SHUT_WR)
        self.socket.close()

    def hang_up(self) -> None:
        """Close the connection now, whatever the client does; this ends reader and writer."""
        self.socket.hang_up()


class FastWebSocketWSGI(WebSocketWSGI):
    """WSGI application by which engineio turns a request into a `FastWebSocket`."""

    def __init__(self, handler: MethodType, server: Server) -> None:
        super().__init__(functools.partial(self._handle, handler.__self__, server))
        self.support_legacy_versions = False  # drafts of 2010, which have no mask

    def _negotiate_permessage_deflate(self, extensions: object) -> None:
        return None  # compression does not shrink a JPEG

    def _handle_hybi_request(self, environ: dict) -> FastWebSocket:
        plain = super()._handle_hybi_request(environ)  # does the handshake, and reads nothing
        return FastWebSocket(plain.socket, environ, plain.version)

    def _handle(self, session: Socket, server: Server, websocket: FastWebSocket) -> None:
        try:
            session._websocket_handler(websocket)
        except Exception:
            # engineio decodes a packet outside its own `try`: after a malformed packet the session
            # would stay open and never answer again.
            server.logger.exception("malformed packet")
            server.drop(session.sid)


def _readiness(sock: GreenSocket) -> Callable[[], object]:
    """Return a function that returns whether the system accepts bytes of a socket at once."""
    descriptor = sock.fileno()
    if not hasattr(select, "poll"):  # Windows
        return lambda: select.select([], [descriptor], [], 0)[1]
    poll = select.poll()  # `select` takes no descriptor above 1,023
    poll.register(descriptor, select.POLLOUT)  # type: ignore[attr-defined,unused-ignore]
    return functools.partial(poll.poll, 0)

"""Engine.IO server and WebSockets on eventlet, fast enough for 60 frames per second, and bounded.

Each override of a library's method is here for a figure or a limit; `tests/zoo/drive` names the
versions that they were checked with. Without one of them, the original client's two loops at 60
frames per second were answered so (2 cores, medians of 7 turns; 120 messages per second are asked):

| without | messages/s | p50 | p99 | CPU per message |
|---|---:|---:|---:|---:|
| nothing | 119.5 | 1.4 ms | 6.2 ms | 0.8 ms |
| `_apply_mask`: unmask a frame in one operation | 119.0 | 2.6 x | 1.6 x | 2.4 x |
| `TCP_QUICKACK`: acknowledge each read at once | 39.5 | 32 x | 8.0 x | 1.3 x |
| `TCP_NODELAY`: send each reply at once | 95.0 | 0.8 x | 2.8 x | 1.0 x |

The client is that of `benchmarks/driver.py`, and no network drives; each override was replaced by
the library's own method. Overrides that gained less (reading ahead, sending from the answering
task) are gone: together they made the answer with PilotNet 4 % slower. The others bound what a
hostile client takes: memory of messages, tasks of PINGs, turns of small frames.
"""

import contextlib
import functools
import re
import socket
import sys
import time
from collections.abc import Callable
from types import MethodType
from typing import Any

import engineio
import eventlet
from engineio import packet
from engineio.socket import Socket
from eventlet.greenio import GreenSocket
from eventlet.websocket import RFC6455WebSocket, WebSocketWSGI

MAX_MESSAGE = 2 << 20  # bytes; the largest allowed image, 1 MB, takes 1.33 MB in base64
ENVIRON_KEY = "drivezoo.websocket"  # key of a session's WebSocket in its environ
HOLD_KEY = "drivezoo.hold"  # key of the function that counts the bytes that a WebSocket holds
FLOOD_KEY = "drivezoo.flood"  # key of the function that closes a connection that floods
COPIES = 3  # copies of a message during its answer: eventlet's, engineio's and the JSON's

BINARY = 2  # the opcode

_TELEMETRY = re.compile(rb'42\d*\s*\[\s*"telemetry"')
SMALL_FRAME = 512  # bytes; below, a frame takes as long to read as an empty one
# Small frames in a second. A telemetry has one or two; two loops at 60 fps send 120 a second.
MOST_SMALL = 2000
SMALL_TURN = 32  # small frames of a message that are read before other clients run
_LARGE_READ = 1 << 15  # bytes of a read after which other clients run

_SMALL = 4096  # characters; eventlet and engineio may keep a shorter message until the next
_QUICKACK = getattr(socket, "TCP_QUICKACK", None)  # exists, and is needed, only on Linux


class EagerSocket:
    """Green socket that acknowledges received bytes, and sends replies, at once.

    Args:
        sock: connection to the client.
        hold: function that counts the bytes of the unfinished message; it may wait.
    """

    def __init__(self, sock: GreenSocket, hold: Callable[[int], None]) -> None:
        self._sock, self._hold, self._unfinished = sock, hold, 0
        self._hung_up = False
        # Send each reply at once, without waiting for the client's acknowledgement of the last.
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def recv(self, size: int) -> bytes:
        """Return at most `size` bytes; none if the client has closed the connection."""
        if self._hung_up:
            return b""
        received = self._sock.recv(size)
        if len(received) > _LARGE_READ:  # more waits, which would never give way
            eventlet.sleep(0)
        if _QUICKACK is not None and received:
            # Set again after each read, since the kernel resets it. Otherwise the kernel delays
            # the acknowledgement by 40 ms, and the client's Nagle algorithm waits for it.
            self._sock.setsockopt(socket.IPPROTO_TCP, _QUICKACK, 1)
        self._unfinished = min(self._unfinished + len(received), MAX_MESSAGE)
        self._hold(self._unfinished)
        return b"" if self._hung_up else received  # it may have been hung up while it waited

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
    """eventlet's WebSocket with five changes.

    It unmasks a frame in one operation, answers the Engine.IO PING of the clients of 2016, drops
    bytes above `MAX_MESSAGE` on arrival, and frees a large message after its answer. It lets other
    clients run after every message, and ends a flood of small frames.

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

    class Message(RFC6455WebSocket.Message):
        """A message that keeps only its beginning once it is too long."""

        size = 0
        data: list[bytearray]

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

    def send(self, message: str | bytes, **options: object) -> None:
        """Send a message and note the time."""
        super().send(message, **options)
        self.sent_s = time.perf_counter()

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

    def __init__(self, handler: MethodType, server: engineio.Server) -> None:
        super().__init__(functools.partial(self._handle, handler.__self__, server))
        self.support_legacy_versions = False  # drafts of 2010, which have no mask

    def _negotiate_permessage_deflate(self, extensions: object) -> None:
        return None  # compression does not shrink a JPEG

    def _handle_hybi_request(self, environ: dict) -> FastWebSocket:
        plain = super()._handle_hybi_request(environ)  # does the handshake, and reads nothing
        return FastWebSocket(plain.socket, environ, plain.version)

    def _handle(self, session: Socket, server: "FastEngine", websocket: FastWebSocket) -> None:
        try:
            session._websocket_handler(websocket)
        except Exception:
            # engineio decodes a packet outside its own `try`: after a malformed packet the session
            # would stay open and never answer again.
            server.logger.exception("malformed packet")
            server.drop(session.sid)


class FastEngine(engineio.Server):
    """engineio's server with a table of the PINGs to send.

    engineio itself starts a task for each PING, which sleeps for 25 s even if its session ends. A
    thousand short sessions per second would thus leave 25,000 tasks.
    """

    _async: dict[str, Any]

    def __init__(self, **options: object) -> None:
        super().__init__(**options)
        self._async = self._async | {"websocket": FastWebSocketWSGI}
        self._pings: dict[str, float] = {}  # time of the next PING by session id

    def start_background_task(
        self, target: object, *arguments: object, **options: object
    ) -> object | None:
        """Start a task as engineio does, but put a PING into the table."""
        if isinstance(target, MethodType) and target.__func__ is Socket._send_ping:
            session: Socket = target.__self__
            self._pings[session.sid] = time.monotonic() + self.ping_interval
            return None
        return super().start_background_task(target, *arguments, **options)

    def send_pings(self) -> None:
        """Send the PINGs that are due, and remove those of ended sessions."""
        now_s = time.monotonic()
        for sid, due_s in list(self._pings.items()):
            session = self.sockets.get(sid)
            ended = session is None or session.closing or session.closed
            if ended or due_s <= now_s:
                del self._pings[sid]
            if due_s <= now_s and not ended:
                session.last_ping = time.time()
                session.send(packet.Packet(packet.PING))

    def drop(self, sid: str) -> None:
        """Close a session and remove all its state."""
        session = self.sockets.pop(sid, None)
        self._pings.pop(sid, None)
        if session is not None:
            session.close(wait=False, abort=True)

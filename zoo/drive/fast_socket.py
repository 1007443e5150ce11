"""WebSockets that keep up with 60 frames a second and that no client can fill the memory with.

eventlet's own spends 5 to 11 ms on each camera picture: it takes the mask off byte by byte, and
the kernel holds back acknowledgements that the old client's many small fragments wait for.
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

from engineio import Server
from engineio.socket import Socket
from eventlet.greenio import GreenSocket
from eventlet.websocket import ConnectionClosedError, RFC6455WebSocket, WebSocketWSGI

MAX_MESSAGE = 2 << 20  # bytes; an image of the limit, 1 MB, takes 1.33 in base64
ENVIRON_KEY = "drivezoo.websocket"  # where a session's handlers find its WebSocket
HOLD_KEY = "drivezoo.hold"  # where a WebSocket finds the function that counts the bytes it holds
COPIES = 3  # of a message, while it is answered: eventlet's, engineio's, and the JSON's

BINARY = 2  # the opcode

_TELEMETRY = re.compile(rb'42\d*\s*\[\s*"telemetry"')
_READ = 1 << 16
_SMALL = 4096  # characters of a message that eventlet and engineio may keep until the next
_QUICKACK = getattr(socket, "TCP_QUICKACK", None)  # Linux alone has it, and needs it


class EagerSocket:
    """A green socket that reads ahead, and acknowledges what it reads at once.

    Args:
        sock: connection to the client.
        hold: function that counts the bytes of the unfinished message; it may wait.
    """

    def __init__(self, sock: GreenSocket, hold: Callable[[int], None]) -> None:
        self._sock, self._ahead = sock, memoryview(b"")
        self._hold, self._unfinished = hold, 0
        self._hung_up = False
        # Two replies that follow each other must not wait for the client's acknowledgement.
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def recv(self, size: int) -> bytes:
        """At most `size` bytes; none where the client has closed the connection."""
        if self._hung_up:
            return b""
        if not self._ahead:
            self._ahead = memoryview(self._sock.recv(_READ))
            if _QUICKACK is not None and self._ahead:
                # The kernel forgets it, so it is set again after each read: without, it waits
                # 40 ms for the rest of the picture, which Nagle's algorithm holds back.
                self._sock.setsockopt(socket.IPPROTO_TCP, _QUICKACK, 1)
            self._unfinished = min(self._unfinished + len(self._ahead), MAX_MESSAGE)
            self._hold(self._unfinished)
            if self._hung_up:  # while it waited
                self._ahead = self._ahead[:0]
                return b""
        taken, self._ahead = self._ahead[:size], self._ahead[size:]
        return bytes(taken)

    def finished(self, size: int) -> None:
        """Count a message of `size` bytes in place of the unfinished one, which ended."""
        self._unfinished = 0
        self._hold(size)

    def hang_up(self) -> None:
        """Close the connection now, and forget what has come and was not read."""
        self._hung_up = True
        with contextlib.suppress(OSError):  # the client may have closed it first
            self._sock.shutdown(socket.SHUT_RDWR)

    def __getattr__(self, name: str) -> object:
        return getattr(self._sock, name)


class FastWebSocket(RFC6455WebSocket):
    """eventlet's WebSocket with five changes: it reads ahead, takes the mask off in one go, answers
    the Engine.IO PING of 2016's clients, drops what exceeds `MAX_MESSAGE` as it arrives, and keeps
    no large message that was answered.

    Attributes:
        received_s: when the last message had arrived, by `time.perf_counter`.
        sent_s: when the last one had been sent.
    """

    received_s = sent_s = 0.0

    def __init__(self, sock: GreenSocket, environ: dict, version: int) -> None:
        # A frame may have any length: what is too long is dropped, message by message.
        hold = environ.get(HOLD_KEY, lambda size: None)
        super().__init__(EagerSocket(sock, hold), environ, version, max_frame_length=1 << 62)
        environ[ENVIRON_KEY] = self
        self._large = False  # the last message
        self._takes = select.poll()
        self._takes.register(sock.fileno(), select.POLLOUT)

    class Message(RFC6455WebSocket.Message):
        """A message that forgets all but its beginning once it is too long."""

        size = 0

        def push(self, data: bytes, final: bool = False) -> None:
            self.finished = final
            self.size += len(data)
            if not self.data:  # one object: each piece of one byte would take 42
                self.data = [bytearray()]
            if self.size <= MAX_MESSAGE:
                self.data[0] += data
            else:
                del self.data[0][64:]

        def getvalue(self) -> bytes | str:
            if self.size <= MAX_MESSAGE:
                return super().getvalue()
            # It gets its reply all the same: the client would wait for it for ever.
            if self.opcode == BINARY:
                return b""
            begins_so = _TELEMETRY.match(self.data[0][:64])
            return f'42["telemetry","{self.size} bytes"]' if begins_so else "6"

    class UTF8Decoder:
        """Bytes that are no UTF-8 are rubbish like any other, and no reason to hang up."""

        def decode(self, data: bytes, final: bool = False) -> str:
            return data.decode("utf-8", "replace")

    def _get_bytes(self, numbytes: int) -> bytes:
        data = self.socket.recv(numbytes)
        while len(data) < numbytes:
            more = self.socket.recv(numbytes - len(data))
            if not more:
                raise ConnectionClosedError
            data += more
        return data

    @staticmethod
    def _apply_mask(
        data: bytes, mask: tuple[int, ...], length: int | None = None, offset: int = 0
    ) -> bytes:
        size, turn = len(data), offset % 4
        key = bytes(mask[turn:] + mask[:turn]) * (size // 4 + 1)
        number = int.from_bytes(data, "little") ^ int.from_bytes(key[:size], "little")
        return number.to_bytes(size, "little")

    def wait(self) -> str | bytes | None:
        """The next message; None once the connection is closed. PINGs are answered on the way."""
        if self._large:
            # engineio's and eventlet's loops refer to the last message until the next: forget it.
            self._large = False
            self.iterator = self._iter_frames()
            return "6"
        self.socket.finished(0)
        while True:
            message = super().wait()
            # Since Engine.IO 4 it is the server that pings, and a client's bare "2" is an error.
            # One with more ("2probe") belongs to the change from polling to a WebSocket.
            if message != "2":
                self.received_s = time.perf_counter()
                self._large = message is not None and len(message) > _SMALL
                self.socket.finished(COPIES * sys.getsizeof(message) if self._large else 0)
                return message
            self.send("3")

    def send(self, message: str | bytes, **more: object) -> None:
        super().send(message, **more)
        self.sent_s = time.perf_counter()

    def send_event(self, name: str, argument: dict) -> bool:
        """Send an event of Socket.IO's default namespace now, in the task that calls, if the system
        takes it at once; otherwise nothing is sent, and False."""
        try:
            if self._sendlock.locked() or not self._takes.poll(0):
                return False
            self.send(f"42{json.dumps([name, argument], separators=(',', ':'))}")
        except OSError:  # it has gone, which reading will tell
            return False
        return True

    def close(self, close_data: tuple[int, str] | None = None) -> None:
        """As eventlet's, which prints a line for each client that has closed it first."""
        with contextlib.suppress(OSError):
            self._send_closing_frame(ignore_send_errors=True, close_data=close_data)
            self.socket.shutdown(socket.SHUT_WR)
        self.socket.close()

    def hang_up(self) -> None:
        """Close the connection now, whatever the client does: reader and writer come to an end."""
        self.socket.hang_up()


class FastWebSocketWSGI(WebSocketWSGI):
    """What engineio calls to turn a request into a WebSocket; its driver's, but for the class."""

    def __init__(self, handler: MethodType, server: Server) -> None:
        super().__init__(functools.partial(self._handle, handler.__self__, server))
        self.support_legacy_versions = False  # drafts of 2010, which have no mask

    def _negotiate_permessage_deflate(self, extensions: object) -> None:
        return None  # a JPEG gets no smaller

    def _handle_hybi_request(self, environ: dict) -> FastWebSocket:
        plain = super()._handle_hybi_request(environ)  # shakes hands, and has read nothing yet
        return FastWebSocket(plain.socket, environ, plain.version)

    def _handle(self, session: Socket, server: Server, websocket: FastWebSocket) -> None:
        try:
            session._websocket_handler(websocket)
        except Exception:
            # Engine.IO's handler reads a rubbish packet outside its own `try`: the session would
            # stay, and never answer again.
            server.logger.exception("a packet that is none")
            server.drop(session.sid)

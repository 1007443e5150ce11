"""A WebSocket client with limits on memory and time, for untrusted servers."""

import contextlib
import math
import socket
import threading
import time

import websocket
from websocket._abnf import continuous_frame, frame_buffer

MAX_MESSAGE = 1 << 20  # bytes of one frame and of one message; a driver's reply has about 60
HANDSHAKE_S = 5.0  # seconds for the whole answer to a handshake
_GRACE_S = 0.1  # extra seconds for data that has arrived already


class HandshakeSilentError(ConnectionError):
    """A server that accepts connections but does not answer the handshake."""


class _Frames(frame_buffer):
    def recv_length(self) -> None:
        super().recv_length()
        _check(self.length)


class _Message(continuous_frame):
    def add(self, frame: websocket.ABNF) -> None:
        super().add(frame)
        _check(len(self.cont_data[1]))


class BoundedWebSocket(websocket.WebSocket):
    """websocket-client's WebSocket, with limits on a message and on a handshake.

    The timeout covers a whole message. In the library it restarts with each byte, so that a server
    that sends byte by byte never reaches it.
    """

    def __init__(self, *arguments: object, **options: object) -> None:
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

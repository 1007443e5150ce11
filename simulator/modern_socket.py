"""`protocol=modern`: today's own Socket.IO client, for drivers that know no other."""

import queue

import socketio
import websocket

from simulator.bounded_socket import HANDSHAKE_S, BoundedWebSocket, HandshakeSilentError
from simulator.legacy_socket import websocket_address


class ModernSocket:
    """As `LegacySocket`; announces itself once.

    Raises:
        SimulatorError: a URL that is none.
        OSError: nobody listens there, or the driver refuses or does not answer.
    """

    def __init__(self, url: str) -> None:
        websocket_address(url)
        self._queue: queue.Queue[tuple[str, object]] = queue.Queue()
        self._client = socketio.Client(
            reconnection=False,
            request_timeout=HANDSHAKE_S,
            websocket_extra_options={"class_": BoundedWebSocket},
        )
        for name in ("steer", "manual"):
            self._client.on(name, lambda *data, name=name: self._take(name, data))
        self._client.on("disconnect", lambda *_: self._queue.put(("disconnect", None)))
        try:
            self._client.connect(url, transports=["websocket"], wait_timeout=HANDSHAKE_S)
        except socketio.exceptions.ConnectionError as error:
            raise (HandshakeSilentError if _silent(error) else ConnectionError)(error) from None
        except (ValueError, TypeError, LookupError) as error:  # its OPEN packet is rubbish
            raise ConnectionError(f"its handshake cannot be read: {error}") from None

    def emit(self, name: str, data: object) -> None:
        """Send an event of the default namespace."""
        try:
            self._client.emit(name, (data,))  # for a bare None it would send no argument at all
        except socketio.exceptions.SocketIOError as error:
            raise ConnectionError(str(error)) from None

    def events(self, wait_s: float) -> list[tuple[str, object]]:
        """What came within `wait_s` seconds; as of `LegacySocket`."""
        try:
            event = self._queue.get(timeout=max(wait_s, 0.0005))
        except queue.Empty:
            return []
        if event[0] == "disconnect":
            raise ConnectionError("the driver closed the session")
        return [event]

    def close(self) -> None:
        """End the session."""
        self._client.disconnect()

    def _take(self, name: str, data: tuple) -> None:
        argument = data if len(data) > 1 else data[0] if data else None
        self._queue.put((name, argument))


def _silent(error: BaseException | None) -> bool:
    """Whether a failure to connect comes from a step of the handshake that was not answered."""
    if str(error) == "Unexpected connection error":  # the CONNECT packet's answer did not come
        return True
    silent = (HandshakeSilentError, websocket.WebSocketTimeoutException)
    return error is not None and (isinstance(error, silent) or _silent(error.__context__))

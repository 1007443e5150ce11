"""Socket of `protocol=modern`: python-socketio's client, for drivers that need a recent one."""

import queue

import socketio
import websocket

from zoo.simulator.legacy_socket import (
    HANDSHAKE_S,
    BoundedWebSocket,
    HandshakeSilentError,
    argument_of,
    websocket_address,
)


class ModernSocket:
    """A connection with the interface of `LegacySocket`, by python-socketio.

    Args:
        url: address of the driver, such as `http://127.0.0.1:4567`.

    Raises:
        InputError: the URL is not an address of a driver.
        OSError: no server listens there, or it refuses or does not answer.
    """

    def __init__(self, url: str) -> None:
        websocket_address(url)
        self._queue: queue.Queue[tuple[str, object]] = queue.Queue()
        self._client = socketio.Client(
            reconnection=False,
            request_timeout=HANDSHAKE_S,
            websocket_extra_options={"class_": BoundedWebSocket},
        )
        self._client.on("*", lambda name, *data: self._queue.put((name, argument_of(data))))
        self._client.on("disconnect", lambda *_: self._queue.put(("disconnect", None)))
        try:
            self._client.connect(url, transports=["websocket"], wait_timeout=HANDSHAKE_S)
        except socketio.exceptions.ConnectionError as error:
            raise (HandshakeSilentError if _silent(error) else ConnectionError)(error) from None
        except (ValueError, TypeError, LookupError) as error:  # a malformed OPEN packet
            raise ConnectionError(f"the driver's handshake cannot be read: {error}") from None

    def emit(self, name: str, data: object) -> None:
        """Send an event of the default namespace."""
        try:
            self._client.emit(name, (data,))  # a bare None would be sent as no argument
        except socketio.exceptions.SocketIOError as error:
            raise ConnectionError(str(error)) from None

    def events(self, wait_s: float) -> list[tuple[str, object]]:
        """Return the events received within `wait_s` seconds; see `LegacySocket.events`."""
        try:
            event = self._queue.get(timeout=max(wait_s, 0.0005))
        except queue.Empty:
            # python-socketio reports no end that comes before its connect() has returned
            if self._client.eio.state == "connected":
                return []
            event = ("disconnect", None)
        if event[0] == "disconnect":
            raise ConnectionError("the driver closed the session")
        return [event]

    def close(self) -> None:
        """End the session."""
        self._client.disconnect()


def _silent(error: BaseException | None) -> bool:
    """Return whether connecting failed because a step of the handshake was not answered."""
    # No answer to the CONNECT packet; the second is what python-socketio before 5.17 says.
    if str(error) in ("Unexpected connection error", "One or more namespaces failed to connect"):
        return True
    silent = (HandshakeSilentError, websocket.WebSocketTimeoutException)
    return error is not None and (isinstance(error, silent) or _silent(error.__context__))

"""`protocol=modern`: today's own Socket.IO client, for drivers that know no other."""

import queue

import socketio


class ModernSocket:
    """As `LegacySocket`; announces itself once.

    Raises:
        OSError: nobody listens there, or the driver refuses.
    """

    def __init__(self, url: str) -> None:
        self._queue: queue.Queue[tuple[str, object]] = queue.Queue()
        self._client = socketio.Client(reconnection=False)
        for name in ("steer", "manual"):
            self._client.on(name, lambda *data, name=name: self._take(name, data))
        self._client.on("disconnect", lambda *_: self._queue.put(("disconnect", None)))
        try:
            self._client.connect(url, transports=["websocket"], wait_timeout=5)
        except socketio.exceptions.ConnectionError as error:
            raise ConnectionError(str(error)) from None

    def emit(self, name: str, data: object) -> None:
        """Send an event of the default namespace."""
        try:
            self._client.emit(name, data)
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
        self._queue.put((name, data[0] if data else None))

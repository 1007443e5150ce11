"""Engine.IO on eventlet with our WebSockets, and with sessions that leave nothing behind."""

import time

import engineio
from engineio import packet
from engineio.socket import Socket

from zoo.drive.fast_socket import FastWebSocketWSGI


class FastEngine(engineio.Server):
    """engineio's server, which sends its PINGs from a table.

    engineio starts a task for each PING, which sleeps for 25 s whether its session lives or not: a
    thousand sessions a second that come and go would leave 25,000 tasks behind.
    """

    def __init__(self, **options: object) -> None:
        super().__init__(**options)
        self._async = self._async | {"websocket": FastWebSocketWSGI}
        self._pings: dict[str, float] = {}  # when each session is to be sent one

    def start_background_task(
        self, target: object, *arguments: object, **options: object
    ) -> object | None:
        """Start a task as engineio does; a PING becomes an entry of the table."""
        if getattr(target, "__func__", None) is Socket._send_ping:
            self._pings[target.__self__.sid] = time.monotonic() + self.ping_interval
            return None
        return super().start_background_task(target, *arguments, **options)

    def send_pings(self) -> None:
        """Send the PINGs that are due, and forget those of sessions that ended."""
        now_s = time.monotonic()
        for sid, due_s in list(self._pings.items()):
            session = self.sockets.get(sid)
            gone = session is None or session.closing or session.closed
            if gone or due_s <= now_s:
                del self._pings[sid]
            if due_s <= now_s and not gone:
                session.last_ping = time.time()
                session.send(packet.Packet(packet.PING))

    def drop(self, sid: str) -> None:
        """End a session and keep nothing of it."""
        session = self.sockets.pop(sid, None)
        self._pings.pop(sid, None)
        if session is not None:
            session.close(wait=False, abort=True)

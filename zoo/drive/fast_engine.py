"""Engine.IO server on eventlet, with fast WebSockets and without tasks of ended sessions."""

import time

import engineio
from engineio import packet
from engineio.socket import Socket

from zoo.drive.fast_socket import FastWebSocketWSGI


class FastEngine(engineio.Server):
    """engineio's server with a table of the PINGs to send.

    engineio itself starts a task for each PING, which sleeps for 25 s even if its session ends. A
    thousand short sessions per second would thus leave 25,000 tasks.
    """

    def __init__(self, **options: object) -> None:
        super().__init__(**options)
        self._async = self._async | {"websocket": FastWebSocketWSGI}
        self._pings: dict[str, float] = {}  # time of the next PING by session id

    def start_background_task(
        self, target: object, *arguments: object, **options: object
    ) -> object | None:
        """Start a task as engineio does, but put a PING into the table."""
        if getattr(target, "__func__", None) is Socket._send_ping:
            self._pings[target.__self__.sid] = time.monotonic() + self.ping_interval
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

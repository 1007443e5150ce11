"""Socket.IO server for current clients and for the original simulator's client of 2016.

The client of 2016 announces Engine.IO 4 (`EIO=4`) but speaks Engine.IO 3. It never connects to a
namespace, so that a current server silently drops its telemetry and the car never moves. Here, its
first event connects it. It also sends PINGs itself, which `fast_socket` answers.
"""

import logging
import re
import time

import socketio

from zoo.server.connections import QUIET_S
from zoo.server.fast_socket import ENVIRON_KEY, MAX_MESSAGE, FastEngine

# Start of an event in the default namespace, with or without attachments and an id.
_EVENT = re.compile(r"(?:2|5\d+-)\d*\s*\[")
_TELEMETRY = re.compile(_EVENT.pattern + r'\s*"telemetry"')
_UNREADABLE = '2["telemetry","unreadable"]'
MOST_QUIET = 64  # polling sessions without telemetry
MOST_HEARD = 64  # polling sessions with telemetry
MOST_UNSENT = 64  # replies that a client has not read; the original leaves one or two
MOST_ATTACHMENTS = 4  # of an event; a telemetry has one image
MOST_UNFINISHED = 8  # events of all clients that wait for attachments
MOST_COMMAS = 1000  # of an event; 2 MiB of empty lists take 43 MB once parsed


class SimulatorServer(socketio.Server):
    """Socket.IO server; events of a session run in order, within the session's task.

    Args:
        logger: logger of clients' errors.
        origin_allowed: function for engineio's `cors_allowed_origins`.
    """

    def __init__(self, logger: logging.Logger, origin_allowed: object) -> None:
        super().__init__(
            logger=logger,
            engineio_logger=logger,
            async_mode="eventlet",
            async_handlers=False,
            cors_allowed_origins=origin_allowed,
            max_http_buffer_size=MAX_MESSAGE,
        )
        self._undecided: set[str] = set()  # Engine.IO sessions that have not connected or left
        # Long-polling sessions by Engine.IO id, the oldest first: time of opening of those without
        # telemetry, and those with telemetry in the order of their last one. Without a limit, an
        # attack took 500 MB in a minute, since a session lasts 45 s without another request.
        self._quiet: dict[str, float] = {}
        self._driving: dict[str, float] = {}

    def heard(self, eio_sid: str) -> None:
        """Note that an Engine.IO session sent telemetry."""
        if eio_sid in self._quiet or eio_sid in self._driving:
            self._forget(eio_sid)
            self._keep(eio_sid, self._driving, MOST_HEARD)

    def _keep(self, eio_sid: str, sessions: dict[str, float], most: int) -> None:
        sessions[eio_sid] = time.monotonic()
        while len(sessions) > most:
            self._end(next(iter(sessions)))

    def _forget(self, eio_sid: str) -> None:
        self._quiet.pop(eio_sid, None)
        self._driving.pop(eio_sid, None)

    def _end(self, eio_sid: str) -> None:
        self._forget(eio_sid)
        self.eio.drop(eio_sid)

    def tend(self) -> None:
        """Close overdue sessions, and those that read no replies; send PINGs; once a second."""
        now_s = time.monotonic()
        for eio_sid in [sid for sid, since_s in self._quiet.items() if now_s - since_s > QUIET_S]:
            self._end(eio_sid)
        for eio_sid, session in list(self.eio.sockets.items()):
            if session.queue.qsize() >= MOST_UNSENT:
                self.hang_up(eio_sid)
        self.eio.send_pings()

    def hang_up(self, eio_sid: str) -> None:
        """Close a session now, whatever the client does."""
        websocket = self.environ.get(eio_sid, {}).get(ENVIRON_KEY)
        if websocket is not None:
            websocket.hang_up()
        else:
            self.eio.drop(eio_sid)

    def _engineio_server_class(self) -> type[FastEngine]:
        return FastEngine

    def _handle_eio_connect(self, eio_sid: str, environ: dict) -> None:
        self._undecided.add(eio_sid)
        super()._handle_eio_connect(eio_sid, environ)
        if environ.get("HTTP_UPGRADE", "").lower() != "websocket":
            self._keep(eio_sid, self._quiet, MOST_QUIET)

    def _handle_eio_disconnect(self, eio_sid: str, reason: str) -> None:
        self._undecided.discard(eio_sid)
        self._forget(eio_sid)
        self._binary_packet.pop(eio_sid, None)
        super()._handle_eio_disconnect(eio_sid, reason)

    def _handle_connect(self, eio_sid: str, namespace: str | None, data: object) -> None:
        if namespace in (None, "/"):
            self._undecided.discard(eio_sid)
        super()._handle_connect(eio_sid, namespace, data)

    def _handle_disconnect(self, eio_sid: str, namespace: str | None, *reason: str) -> None:
        # A client that left, or was disconnected, must not be connected again by its events.
        self._undecided.discard(eio_sid)
        super()._handle_disconnect(eio_sid, namespace, *reason)

    def _handle_eio_message(self, eio_sid: str, data: str | bytes) -> None:
        """Dispatch a message.

        An unreadable telemetry is passed on as such, since the client waits for a reply to it.
        """
        text = data if isinstance(data, str) else ""
        if text.count(",") > MOST_COMMAS:
            if not _TELEMETRY.match(text):
                return
            data = text = _UNREADABLE
        if text and self._binary_packet.get(eio_sid) is not None:
            self._give_up_attachments(eio_sid)
        if eio_sid in self._undecided and _EVENT.match(text):
            self._handle_connect(eio_sid, "/", None)
        try:
            super()._handle_eio_message(eio_sid, data)
            self._limit_attachments(eio_sid)
        except Exception as error:
            if eio_sid in self._binary_packet:
                self._give_up_attachments(eio_sid)
            elif not isinstance(error, ValueError | RecursionError):
                raise
            elif _TELEMETRY.match(text):  # no JSON, or JSON that overflows the stack
                super()._handle_eio_message(eio_sid, _UNREADABLE)
            elif text.startswith("0") and eio_sid in self._undecided:
                self._handle_connect(eio_sid, "/", None)  # its `auth` is no JSON
            else:
                raise

    def _limit_attachments(self, eio_sid: str) -> None:
        packet = self._binary_packet.get(eio_sid)
        if packet is None:
            return
        size = sum(map(len, packet.attachments))
        if not 0 < packet.attachment_count <= MOST_ATTACHMENTS or size > MAX_MESSAGE:
            self._give_up_attachments(eio_sid)
        while len(self._binary_packet) > MOST_UNFINISHED:
            self._give_up_attachments(next(iter(self._binary_packet)))

    def _give_up_attachments(self, eio_sid: str) -> None:
        """Drop an event that waits for attachments; pass on a telemetry as unreadable."""
        data = self._binary_packet.pop(eio_sid).data
        if isinstance(data, list) and data[:1] == ["telemetry"]:
            super()._handle_eio_message(eio_sid, _UNREADABLE)

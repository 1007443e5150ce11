"""Limits of Engine.IO sessions by long polling, each of which a client opens by one request."""

import time
from collections.abc import Callable

from zoo.drive.connections import QUIET_S

MOST_QUIET = 64  # sessions without telemetry
MOST_HEARD = 64  # sessions with telemetry


class PollingSessions:
    """Sessions by their Engine.IO id; the oldest is closed when there are too many.

    Without a limit, an attack took 500 MB in a minute, since a session lasts 45 s without another
    request.

    Args:
        close: function that closes a session; engineio then calls `closed`.
    """

    def __init__(self, close: Callable[[str], None]) -> None:
        self._close = close
        self._quiet: dict[str, float] = {}  # time of opening by session, the oldest first
        self._heard: dict[str, None] = {}  # sessions in the order of their last telemetry

    def opened(self, eio_sid: str) -> None:
        """Add a new session; close the oldest if there are too many."""
        self._quiet[eio_sid] = time.monotonic()
        while len(self._quiet) > MOST_QUIET:
            self._end(next(iter(self._quiet)))

    def heard(self, eio_sid: str) -> None:
        """Note that a session sent telemetry."""
        if eio_sid not in self._quiet and eio_sid not in self._heard:
            return  # a WebSocket session
        self.closed(eio_sid)
        self._heard[eio_sid] = None
        if len(self._heard) > MOST_HEARD:
            self._end(next(iter(self._heard)))

    def closed(self, eio_sid: str) -> None:
        """Forget a session that has ended or changed to a WebSocket."""
        self._quiet.pop(eio_sid, None)
        self._heard.pop(eio_sid, None)

    def close_overdue(self) -> None:
        """Close the sessions that never sent telemetry."""
        now_s = time.monotonic()
        for eio_sid in [sid for sid, since in self._quiet.items() if now_s - since > QUIET_S]:
            self._end(eio_sid)

    def _end(self, eio_sid: str) -> None:
        self.closed(eio_sid)
        self._close(eio_sid)

"""Engine.IO sessions of long polling, which cost a client one request each and no connection."""

import time
from collections.abc import Callable

from zoo.drive.connections import QUIET_S

MOST_QUIET = 64  # sessions without telemetry
MOST_HEARD = 64  # sessions with telemetry


class PollingSessions:
    """Sessions by their Engine.IO id; the oldest are closed once there are too many.

    Without a limit they took 500 MB in a minute: each is there for 45 s without another request.

    Args:
        close: closes a session, which leads to `closed`.
    """

    def __init__(self, close: Callable[[str], None]) -> None:
        self._close = close
        self._quiet: dict[str, float] = {}  # when each was opened, the oldest first
        self._heard: dict[str, None] = {}  # the one whose telemetry came last is last

    def opened(self, eio_sid: str) -> None:
        """Keep a new session, and close the oldest of too many."""
        self._quiet[eio_sid] = time.monotonic()
        while len(self._quiet) > MOST_QUIET:
            self._end(next(iter(self._quiet)))

    def heard(self, eio_sid: str) -> None:
        """Note a session's telemetry."""
        if eio_sid not in self._quiet and eio_sid not in self._heard:
            return  # a WebSocket's
        self.closed(eio_sid)
        self._heard[eio_sid] = None
        if len(self._heard) > MOST_HEARD:
            self._end(next(iter(self._heard)))

    def closed(self, eio_sid: str) -> None:
        """Forget a session: it ended, or has a WebSocket now, and so a connection of its own."""
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

"""Open connections: their limits, the memory they take, and which are closed to make room."""

import contextlib
import functools
import socket
import time
from collections import Counter
from dataclasses import dataclass

import eventlet
from eventlet.greenio import GreenSocket
from eventlet.greenthread import GreenThread, getcurrent

from zoo.base.notices import Notices
from zoo.server.fast_socket import COPIES, ENVIRON_KEY, FLOOD_KEY, HOLD_KEY, MAX_MESSAGE

MOST_CONNECTIONS = 1024
MOST_PER_ADDRESS = 512  # fewer than in total, so that there is room for other addresses
MOST_QUIET_WEBSOCKETS = 256  # without telemetry, of one address
HEAD_S = 5.0  # limit for a request's head, from the first byte to the last
REQUEST_S = 60.0  # limit for a request; long polling takes up to 45 s
QUIET_S = 20.0  # limit for the first telemetry of a session
MOST_HELD = 16 << 20  # bytes; the largest allowed image takes 1.33 MB in base64
FLOOD = "connection closed: more than 2,000 small messages or fragments in a second"


@dataclass(eq=False)
class Connection:
    """An open connection.

    Attributes:
        task: green thread that serves the connection.
        socket: socket to the client.
        host: address of the client.
        since_s: time at which it was accepted, by `time.monotonic`.
        environ: WSGI environment of its request; None until the request's head has arrived.
        drives: whether telemetry has arrived.
        held: bytes that it holds until its message is answered.
    """

    task: GreenThread
    socket: GreenSocket
    host: str
    since_s: float
    environ: dict | None = None
    drives: bool = False
    held: int = 0

    def overdue(self, now_s: float) -> bool:
        """Return whether the client exceeds the time limit of the connection's present state."""
        if self.environ is None:
            patience_s = HEAD_S
        else:
            patience_s = QUIET_S if ENVIRON_KEY in self.environ else REQUEST_S
        return not self.drives and now_s - self.since_s > patience_s

    @property
    def quiet_websocket(self) -> bool:
        """Whether it is, or will be, a WebSocket, and has sent no telemetry."""
        return not self.drives and (self.environ or {}).get("HTTP_UPGRADE") is not None

    def close(self) -> None:
        """Close the connection now, whatever the client does."""
        websocket = (self.environ or {}).get(ENVIRON_KEY)
        if websocket is not None:  # this ends its reader, and thus the session
            websocket.hang_up()
            return
        with contextlib.suppress(OSError):  # the client may have closed it first
            self.socket.shutdown(socket.SHUT_RDWR)  # the reader has a copy that would stay open
        self.task.kill()
        self.socket.close()  # a task that had not begun does not close it


class Connections:
    """All open connections, the oldest first.

    A connection that drives is never closed for a new one. Of the others, such as half-open ones
    and WebSockets without telemetry, the oldest is closed first. A new simulator can thus connect
    whatever other clients hold open.

    The bytes that connections hold until their messages are answered are limited, too: 512
    connections that send half of the longest message would hold 1 GB. The connection with the
    largest message is closed first, and the oldest of equal ones. A simulator's message of about
    20 kB is then never the largest.

    Args:
        most: greatest number of open connections.
        notices: log of closed connections.
    """

    def __init__(self, most: int, notices: Notices) -> None:
        self.most, self.most_per_host = most, min(MOST_PER_ADDRESS, max(most // 2, 1))
        self._notices = notices
        self._open: dict[GreenThread, Connection] = {}
        self._hosts: Counter[str] = Counter()
        self._held = 0  # bytes of all connections

    def __len__(self) -> int:
        return len(self._open)

    def make_room(self, host: str) -> bool:
        """Close connections until a new one of `host` fits; return False if all of them drive."""
        while (crowded := self._hosts[host] >= self.most_per_host) or len(self) >= self.most:
            idle = (client for client in self._open.values() if not client.drives)
            oldest = next((client for client in idle if not crowded or client.host == host), None)
            if oldest is None:
                self._notices.report("connection refused: too many simulators drive", host)
                return False
            self._close(oldest, "oldest idle connection closed: too many are open")
        return True

    def add(self, task: GreenThread, socket: GreenSocket, host: str) -> None:
        """Add a connection.

        Args:
            task: green thread that will serve it, and has not begun.
            socket: socket to the client.
            host: address of the client.
        """
        self._open[task] = Connection(task, socket, host, time.monotonic())
        self._hosts[host] += 1

    def remove(self, task: GreenThread) -> None:
        """Forget a connection, if it is still known."""
        connection = self._open.pop(task, None)
        if connection is not None:
            self._held -= connection.held
            self._hosts -= Counter([connection.host])  # without those that are 0

    def head_came(self, environ: dict) -> None:
        """Note the request of the current task's connection, and count its bytes.

        Args:
            environ: WSGI environment of the request.
        """
        task = getcurrent()
        connection = self._open[task]
        connection.environ = environ
        environ[HOLD_KEY] = functools.partial(self._hold, task)
        environ[FLOOD_KEY] = functools.partial(self._close, connection, FLOOD)
        if connection.quiet_websocket:
            self._limit_quiet(connection.host)
        body = environ.get("CONTENT_LENGTH") or ""
        if body.isdecimal():
            self._hold(task, COPIES * min(int(body), MAX_MESSAGE))

    def telemetry_came(self) -> None:
        """Note that the current task's connection drives."""
        connection = self._open.get(getcurrent())
        if connection is not None:
            connection.drives = True

    def close_overdue(self) -> None:
        """Close the connections that exceed their time limit."""
        now_s = time.monotonic()
        for connection in [opened for opened in self._open.values() if opened.overdue(now_s)]:
            kind = "telemetry" if ENVIRON_KEY in (connection.environ or ()) else "whole request"
            self._close(connection, f"connection closed: no {kind} in time")

    def _hold(self, task: GreenThread, size: int) -> None:
        """Set the bytes of a connection, and wait until the sum is at most `MOST_HELD`."""
        if task not in self._open:  # a closed connection may read once more
            return
        connection = self._open[task]
        self._held += size - connection.held
        connection.held = size
        while self._held > MOST_HELD and task in self._open:
            eventlet.sleep()  # other connections run, which frees their answered messages
            if self._held > MOST_HELD:
                largest = max(self._open.values(), key=lambda connection: connection.held)
                self._close(largest, "connection closed: unfinished messages take too much")
                eventlet.sleep()

    def _limit_quiet(self, host: str) -> None:
        alike = [link for link in self._open.values() if link.host == host and link.quiet_websocket]
        for oldest in alike[:-MOST_QUIET_WEBSOCKETS]:
            self._close(oldest, "oldest WebSocket without telemetry closed: too many")

    def _close(self, connection: Connection, why: str) -> None:
        self._notices.report(why, connection.host)
        self.remove(connection.task)
        connection.close()

"""The open connections: how many there may be, and which are closed to make room."""

import contextlib
import functools
import socket
import time
from collections import Counter
from collections.abc import Hashable
from dataclasses import dataclass

import eventlet
from eventlet.greenio import GreenSocket
from eventlet.greenthread import GreenThread, getcurrent

from zoo.drive.fast_socket import COPIES, ENVIRON_KEY, HOLD_KEY, MAX_MESSAGE
from zoo.drive.held_bytes import HeldBytes
from zoo.drive.notices import Notices

MOST_CONNECTIONS = 1024
MOST_PER_ADDRESS = 512  # below it, so that another address always finds a place
MOST_QUIET_WEBSOCKETS = 256  # of an address; without telemetry
HEAD_S = 5.0  # for a request's head, from the first byte to the last
REQUEST_S = 60.0  # for a request; one of long polling waits for 45 s
QUIET_S = 20.0  # for the first telemetry of a session


@dataclass(eq=False)
class Connection:
    """An open connection.

    Attributes:
        task: serves it.
        socket: to the client.
        host: address of the client.
        since_s: when it was accepted.
        environ: of its request; None until the request's head is there.
        drives: telemetry came.
    """

    task: GreenThread
    socket: GreenSocket
    host: str
    since_s: float
    environ: dict | None = None
    drives: bool = False

    def overdue(self, now_s: float) -> bool:
        """Whether the client took too long for what the connection waits for."""
        if self.environ is None:
            patience_s = HEAD_S
        else:
            patience_s = QUIET_S if ENVIRON_KEY in self.environ else REQUEST_S
        return not self.drives and now_s - self.since_s > patience_s

    @property
    def quiet_websocket(self) -> bool:
        """Whether it is a WebSocket, or will be one, without telemetry."""
        return not self.drives and (self.environ or {}).get("HTTP_UPGRADE") is not None

    def close(self) -> None:
        """Close it now, whatever the client does."""
        websocket = (self.environ or {}).get(ENVIRON_KEY)
        if websocket is not None:  # its reader ends, which also ends the session
            websocket.hang_up()
            return
        with contextlib.suppress(OSError):  # the client may have closed it first
            self.socket.shutdown(socket.SHUT_RDWR)  # a reader's copy would keep it open
        self.task.kill()
        self.socket.close()  # the task closes it, but for one that had not begun


class Connections:
    """All connections, the oldest first.

    A simulator that drives is never closed for a new connection. Of all others, half-open ones and
    WebSockets without telemetry included, the oldest goes first: a new simulator finds a place
    whatever another client holds open.

    Args:
        most: connections at a time.
        notices: told which are closed.
    """

    def __init__(self, most: int, notices: Notices) -> None:
        self.most, self.most_per_host = most, min(MOST_PER_ADDRESS, max(most // 2, 1))
        self._notices = notices
        self._open: dict[GreenThread, Connection] = {}
        self._hosts: Counter[str] = Counter()
        self._held = HeldBytes(eventlet.sleep, self._close_holder)

    def __len__(self) -> int:
        return len(self._open)

    def make_room(self, host: str) -> bool:
        """Close what exceeds the limits with one more; False where only driving ones are left."""
        while (crowded := self._hosts[host] >= self.most_per_host) or len(self) >= self.most:
            idle = (one for one in self._open.values() if not one.drives)
            oldest = next((one for one in idle if not crowded or one.host == host), None)
            if oldest is None:
                self._notices.say("too many simulators drive, a connection was refused", host)
                return False
            self._notices.say("too many connections, the oldest idle one was closed", oldest.host)
            self._close(oldest)
        return True

    def add(self, task: GreenThread, socket: GreenSocket, host: str) -> None:
        """Keep a connection that a task, which has not begun, will serve."""
        self._open[task] = Connection(task, socket, host, time.monotonic())
        self._hosts[host] += 1

    def remove(self, task: GreenThread) -> None:
        """Forget a connection, if it was not forgotten before."""
        self._held.release(task)
        connection = self._open.pop(task, None)
        if connection is not None:
            self._hosts[connection.host] -= 1
            if not self._hosts[connection.host]:
                del self._hosts[connection.host]

    def head_came(self, environ: dict) -> None:
        """Note the request of the connection that the current task serves, and count its bytes."""
        task = getcurrent()
        connection = self._open[task]
        connection.environ = environ
        environ[HOLD_KEY] = functools.partial(self._hold, task)
        if connection.quiet_websocket:
            self._limit_quiet(connection.host)
        body = environ.get("CONTENT_LENGTH") or ""
        if body.isdecimal():
            self._hold(task, COPIES * min(int(body), MAX_MESSAGE))

    def telemetry_came(self) -> None:
        """Note that the connection that the current task serves drives."""
        connection = self._open.get(getcurrent())
        if connection is not None:
            connection.drives = True

    def close_overdue(self) -> None:
        """Close the connections whose client took too long."""
        now_s = time.monotonic()
        for connection in [one for one in self._open.values() if one.overdue(now_s)]:
            kind = "telemetry" if ENVIRON_KEY in (connection.environ or ()) else "whole request"
            self._notices.say(f"a connection without a {kind} was closed", connection.host)
            self._close(connection)

    def _hold(self, task: GreenThread, size: int) -> None:
        if task in self._open:  # one that was closed may read once more
            self._held.hold(task, size)

    def _limit_quiet(self, host: str) -> None:
        alike = [one for one in self._open.values() if one.host == host and one.quiet_websocket]
        for oldest in alike[:-MOST_QUIET_WEBSOCKETS]:
            self._notices.say("too many WebSockets without telemetry, the oldest was closed", host)
            self._close(oldest)

    def _close_holder(self, task: Hashable) -> None:
        holder = self._open[task]
        self._notices.say("too many unfinished messages, the largest was closed", holder.host)
        self._close(holder)

    def _close(self, connection: Connection) -> None:
        self.remove(connection.task)
        connection.close()

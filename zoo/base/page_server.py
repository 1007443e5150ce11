"""HTTP server of a page that a command serves, with a thread for each request."""

import contextlib
import errno
import io
import socket
import socketserver
import time
from typing import Any
from wsgiref.simple_server import WSGIRequestHandler, WSGIServer

from zoo.base.errors import InputError
from zoo.base.machine import port_holder
from zoo.base.notices import Notices
from zoo.base.origin import OriginGuard, is_loopback
from zoo.base.page_requests import ServedPage

HOST = "127.0.0.1"
PATIENCE_S = 20.0  # for a whole request to arrive
MOST_REQUEST = 64 << 10  # bytes of a request's head and body
MOST_REQUESTS = 64  # that are answered at a time; a browser sends six


class PageServer(socketserver.ThreadingMixIn, WSGIServer):
    """HTTP server, with a thread for each request.

    Args:
        port: TCP port; 0 for a free one.
        page: page that answers the requests.
        host: address to listen on; other machines reach one that is not a loopback address.
        most_request: bytes of a request's head and body.

    Raises:
        InputError: the host is no address of this machine; or the port is in use, by a process
            that the message names.
    """

    daemon_threads = True
    # On Windows, which alone has this option, two servers of a reused address share its browsers.
    allow_reuse_address = not hasattr(socket, "SO_EXCLUSIVEADDRUSE")

    def __init__(
        self, port: int, page: ServedPage, host: str = HOST, most_request: int = MOST_REQUEST
    ) -> None:
        self.most_request = most_request
        self._open: dict[socket.socket, None] = {}  # the oldest first
        try:
            super().__init__((host, port), _Handler)
        except OSError as error:
            holder = port_holder(port) if error.errno == errno.EADDRINUSE else None
            reason = f"held by {holder}" if holder else error.strerror
            if isinstance(error, socket.gaierror) or error.errno == errno.EADDRNOTAVAIL:
                raise InputError(f"host={host}: {reason}; use the machine's IPv4 address") from None
            raise InputError(f"port={port}: {reason}; add port=0 for a free one") from None
        self.set_app(OriginGuard(not is_loopback(host), Notices())(page))

    def server_bind(self) -> None:
        """Bind the socket, without the name lookup of `http.server`."""
        socketserver.TCPServer.server_bind(self)
        self.server_name, self.server_port = str(self.server_address[0]), self.server_address[1]
        self.setup_environ()

    def process_request(self, request: Any, client_address: object) -> None:
        """Answer a request in a thread; close the oldest when too many are unfinished."""
        self._open[request] = None
        if len(self._open) > MOST_REQUESTS:
            oldest, *_ = list(self._open)  # at once, because threads remove theirs
            self._open.pop(oldest, None)
            with contextlib.suppress(OSError):  # it has just ended
                oldest.shutdown(socket.SHUT_RDWR)
        super().process_request(request, client_address)

    def shutdown_request(self, request: Any) -> None:
        """Close a connection after its answer."""
        self._open.pop(request, None)
        super().shutdown_request(request)

    def handle_error(self, request: object, client_address: object) -> None:
        """Ignore a browser that has closed its connection."""


class _Request(io.RawIOBase):
    """The bytes of a request, which must be few and arrive before a deadline."""

    def __init__(self, connection: socket.socket, most: int) -> None:
        self._connection = connection
        self._ends_s, self._left = time.monotonic() + PATIENCE_S, most

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        left_s = self._ends_s - time.monotonic()
        if left_s <= 0:
            raise TimeoutError("the request did not arrive in time")
        self._connection.settimeout(left_s)
        size = self._connection.recv_into(buffer)
        self._left -= size
        if self._left < 0:
            raise ConnectionError("the request is too long")
        return size


class _Handler(WSGIRequestHandler):
    server: PageServer

    def setup(self) -> None:
        super().setup()
        self.rfile = io.BufferedReader(_Request(self.connection, self.server.most_request))

    def log_message(self, text: str, *values: object) -> None:
        pass  # a line for each image would hide the others

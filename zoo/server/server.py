"""The server of the driver: it accepts connections and sends replies."""

import logging
import socket
import time
from collections.abc import Callable, Iterable
from http import HTTPStatus
from typing import Any

import eventlet
import socketio
from eventlet import wsgi
from eventlet.greenio import GreenSocket
from eventlet.greenthread import GreenThread

from zoo.base.notices import Notices
from zoo.base.origin import OriginGuard
from zoo.server.connections import MOST_CONNECTIONS, Connections
from zoo.server.driver import Driver
from zoo.server.fast_socket import ENVIRON_KEY
from zoo.server.socketio_server import MOST_UNSENT, SimulatorServer

BACKLOG = 1024
CLOSING = 64  # connections that may be closing while new ones are accepted
OTHER_FILES = 128 + CLOSING  # files that the process may have open besides its connections
TEND_EVERY_S = 1.0
PATIENCE_S = 20.0  # a client that sends neither telemetry nor PONG is disconnected after this time

WsgiApp = Callable[[dict, Callable], Iterable[bytes]]


class DriveServer:
    """Server of a driver to simulators on a listening socket.

    eventlet patches no modules, so that torch and the writer's thread use the real `threading` and
    `socket`. The policy runs in the one thread that serves the sockets: its 2 ms are less than the
    worst delay of passing frames to another thread and back.

    Args:
        driver: driver that answers telemetry.
        listener: socket that `listen` returned; `close` closes it.
        page: WSGI application for all paths except `/socket.io/`.
        exposed: whether other machines may reach the server, under any name.
    """

    def __init__(
        self,
        driver: Driver,
        listener: GreenSocket,
        page: WsgiApp | None = None,
        exposed: bool = False,
    ) -> None:
        self.driver, self.listener = driver, listener
        guard = OriginGuard(exposed, driver.notices)
        self.sio = SimulatorServer(_logger(driver.notices), guard.allows)
        self.sio.on("connect", lambda sid, environ, auth=None: driver.connect(sid))
        self.sio.on("disconnect", lambda sid, reason: driver.disconnect(sid))
        self.sio.on("telemetry", self._telemetry)
        # No keep-alive: the original client leaks each connection that is answered by an error, a
        # thousand of them in 2 s, and these must end at once.
        self._http = wsgi.Server(
            listener,
            listener.getsockname(),
            self._note_head(guard(socketio.WSGIApp(self.sio, page))),
            log_output=False,
            protocol=_protocol(driver.notices),
            keepalive=False,
            debug=False,
            socket_timeout=PATIENCE_S,
        )
        most = _connection_limit()
        self._connections = Connections(most, driver.notices)
        self._pool = eventlet.GreenPool(most + CLOSING)
        self._tasks: list[GreenThread] = []

    @property
    def port(self) -> int:
        """Return the port of the listening socket."""
        return self.listener.getsockname()[1]

    def serve(
        self, listening: Callable[[], None], until: Callable[[], bool], tick_s: float = 0.1
    ) -> None:
        """Serve until `until` returns true.

        Polling `until` is safer than an exception raised by a signal, which could end up in any
        session's task and be lost there.

        Args:
            listening: function called once connections are answered.
            until: function that returns whether to stop.
            tick_s: seconds between two calls of `until`.
        """
        self._tasks = [eventlet.spawn(self._accept), eventlet.spawn(self._tend)]
        eventlet.sleep(0)
        listening()
        while not until():
            eventlet.sleep(tick_s)

    def close(self) -> None:
        """Accept no more connections, and close the open ones."""
        for task in self._tasks:
            task.kill()
        self.listener.close()
        for environ in list(self.sio.environ.values()):
            if ENVIRON_KEY in environ:
                environ[ENVIRON_KEY].hang_up()
        eventlet.sleep(0)

    def _accept(self) -> None:
        # eventlet's own loop ends at the first connection that cannot be accepted.
        while True:
            try:
                connection, address = self.listener.accept()
            except OSError as error:
                self.driver.notices.report("a connection could not be accepted", str(error))
                eventlet.sleep(0.05)
                continue
            host = str(address[0])
            if not self._connections.make_room(host):
                connection.close()
                continue
            task = self._pool.spawn(self._serve, connection, address)
            self._connections.add(task, connection, host)
            eventlet.sleep(0)  # let open connections run during a flood of new ones

    def _tend(self) -> None:
        while True:
            eventlet.sleep(TEND_EVERY_S)
            try:
                self._connections.close_overdue()
                self.sio.tend()
            except Exception as error:
                self.driver.notices.report(
                    "closing overdue connections failed", f"{type(error).__name__}: {error}"
                )

    def _note_head(self, app: WsgiApp) -> WsgiApp:
        def noted(environ: dict, start_response: Callable) -> Iterable[bytes]:
            self._connections.head_came(environ)
            return app(environ, start_response)

        return noted

    def _serve(self, connection: GreenSocket, address: object) -> None:
        try:
            connection.settimeout(PATIENCE_S)
            self._http.process_request([address, connection, wsgi.STATE_IDLE])
        except (OSError, EOFError):  # disconnected
            pass
        except Exception as error:
            self.driver.notices.report("a request failed", f"{type(error).__name__}: {error}")
        finally:
            self._connections.remove(eventlet.getcurrent())
            connection.close()

    def _telemetry(self, sid: str, *arguments: object) -> None:
        began_s = time.perf_counter()
        session = self.driver.sessions.get(sid)
        if session is None or self._hung_up(sid):
            return
        self._connections.telemetry_came()
        self.sio.heard(self.sio.manager.eio_sid_from_sid(sid, "/"))
        websocket = self.sio.get_environ(sid).get(ENVIRON_KEY)
        if websocket is not None:
            began_s = websocket.received_s
        # The original sends one argument; null, or no argument, means that a person drives.
        reply = self.driver.answer(session, arguments[0] if arguments else None)
        self.sio.emit(reply.event, reply.values, to=sid)
        # engineio sends it in another task, which must run before the next frame is read.
        eventlet.sleep(0)
        sent_s = websocket.sent_s if websocket is not None else 0.0
        sent_s = sent_s if sent_s > began_s else time.perf_counter()
        self.driver.sent(reply, 1000 * (sent_s - began_s))

    def _hung_up(self, sid: str) -> bool:
        """Disconnect a client that reads no replies; return whether it was."""
        eio_sid = self.sio.manager.eio_sid_from_sid(sid, "/")
        engine = self.sio.eio.sockets.get(eio_sid)
        if engine is None or engine.queue.qsize() < MOST_UNSENT:
            return False
        self.driver.notices.report("a simulator was disconnected: it reads no replies")
        self.sio.hang_up(eio_sid)
        return True


def listen(host: str, port: int) -> GreenSocket:
    """Return a socket that accepts connections from now on, before any is answered.

    The original client then waits. It tries thousands of times per second if the port is closed.

    Raises:
        OSError: the port is in use, or the host does not exist.
    """
    family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
    # With reuse_port, eventlet's default, two drivers would share the port and its simulators.
    return eventlet.listen((host, port), family, backlog=BACKLOG, reuse_port=False)


def _connection_limit() -> int:
    """Return how many connections the limit of open files allows, after raising it if possible."""
    try:
        import resource as module
    except ImportError:  # Windows, where eventlet waits with `select`, which takes 512 sockets
        return 512 - OTHER_FILES
    resource: Any = module  # whose names mypy does not find for Windows
    wanted = MOST_CONNECTIONS + OTHER_FILES
    endless = {resource.RLIM_INFINITY: wanted}
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    soft, hard = (endless.get(limit, limit) for limit in limits)
    if soft < wanted:
        soft = min(wanted, hard)
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, limits[1]))
    return max(min(soft, wanted) - OTHER_FILES, 1)


def _protocol(notices: Notices) -> type[wsgi.HttpProtocol]:
    """Return eventlet's HTTP protocol with a count of bad requests by their status."""

    class Counted(wsgi.HttpProtocol):
        def log_message(self, text: str, *values: object) -> None:
            pass  # eventlet prints two lines for each bad request

        def log_error(self, text: str, *values: Any) -> None:
            # The text is "code %d, message %s", or is about a timeout.
            status = int(values[0]) if text.startswith("code") else HTTPStatus.REQUEST_TIMEOUT
            notices.report(f"a bad HTTP request was refused ({status:d})", text % values)

    return Counted


def _logger(notices: Notices) -> logging.Logger:
    """Return a logger that counts the warnings of socketio and engineio."""

    class Counted(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            error = record.exc_info[1] if record.exc_info else None
            detail = f"{type(error).__name__}: {error}" if error else record.getMessage()
            notices.report("a client sent an invalid Socket.IO message", detail)

    logger = logging.Logger("zoo.commands.drive", logging.WARNING)
    logger.addHandler(Counted())
    return logger

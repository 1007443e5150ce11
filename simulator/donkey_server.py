"""The command `drivezoo simulator serve`: the embedded world on a Donkeycar simulator's port."""

import json
import socket
import time
import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, suppress

from simulator.command_options import ServeOptions
from simulator.donkey_session import RATE, DonkeySession, Message
from zoo.base.errors import InputError
from zoo.base.process_pool import ProcessPool

MOST_BYTES = 1_000_000  # of one message
RECEIVED_BYTES = 65_536
SLOW_S = 5.0  # for a client to take a message
SILENT_S = 60.0  # for a client to choose a scene
LOOK_S = 0.2


class MessageStream:
    """JSON objects out of a stream of text without separators.

    >>> stream = MessageStream()
    >>> list(stream.split(b'{"a": "1"}{"b"')), list(stream.split(b': 2}'))
    ([{'a': '1'}], [{'b': 2}])
    """

    def __init__(self) -> None:
        self._text = b""

    def split(self, received: bytes) -> Iterator[Message]:
        """Yield the objects that are complete after some more bytes.

        Raises:
            InputError: the bytes are no JSON objects, or one is too long.
        """
        self._text = (self._text + received).lstrip()
        while self._text:
            if not self._text.startswith(b"{"):
                raise InputError("sends no JSON objects, so it is no Donkeycar client")
            end = self._text.find(b"}") + 1  # objects of this protocol have none inside
            if not end:
                break
            try:
                message = json.loads(self._text[:end])
            except (ValueError, RecursionError):
                raise InputError("sends an object that is not JSON") from None
            self._text = self._text[end:].lstrip()
            yield message
        if len(self._text) > MOST_BYTES:
            raise InputError(f"sends an object of more than {MOST_BYTES:,} bytes")


def serve_client(
    connection: socket.socket, options: ServeOptions, name: str, report: object
) -> None:
    """Serve a client until it leaves; print a line on what goes wrong."""

    def note(line: str) -> None:
        print(f"client {name}: {line}", flush=True)

    note("connected")
    try:
        _converse(connection, options, note)
        note("disconnected")
    except InputError as error:
        note(f"{error}; disconnected")
    except OSError as error:  # it left in the middle of a message, or takes none
        note(f"{error.strerror or 'takes no messages'}; disconnected")
    except Exception:  # a bug ends one drive, not those of the other clients
        note(f"this is a bug in drivezoo; please report it:\n{traceback.format_exc()}")
    finally:
        with suppress(OSError):  # the client has closed it
            connection.shutdown(socket.SHUT_RDWR)  # now, though the parent has a copy
        connection.close()


def _converse(
    connection: socket.socket, options: ServeOptions, note: Callable[[str], None]
) -> None:
    """Answer a client's messages, and send telemetry at the world's rate, until either ends."""
    lockstep = options.rate == "max"
    rate = RATE if lockstep else float(options.rate)
    session = DonkeySession(options.scene, rate, lockstep, options.renderer, note)
    stream, due_s, last_s = MessageStream(), time.monotonic(), time.monotonic()

    def send(messages: Iterable[Message]) -> None:
        connection.settimeout(SLOW_S)
        for message in messages:
            connection.sendall(json.dumps(message).encode() + b"\n")

    with closing(session):
        send([session.greeting])
        while not session.ended:
            is_due = session.world is not None and not session.waits
            connection.settimeout(max(due_s - time.monotonic(), 1e-4) if is_due else SILENT_S)
            try:
                received = connection.recv(RECEIVED_BYTES)
            except (TimeoutError, BlockingIOError):
                if session.world is None and time.monotonic() - last_s >= SILENT_S:
                    raise InputError(f"chose no scene in {SILENT_S:.0f} s") from None
            else:
                if not received:
                    return
                last_s = time.monotonic()
                for message in stream.split(received):
                    send(session.answer(message))
            if session.world is not None and not session.waits and time.monotonic() >= due_s:
                # Of a frame that comes late, the delay is not caught up.
                due_s = max(due_s + session.world.frame_s, time.monotonic())
                send(session.advance())


def serve(options: ServeOptions) -> None:
    """Serve clients until Ctrl-C, each in a process of its own.

    Raises:
        InputError: the port is taken, or there is no such scene.
    """
    address = options.host, options.port
    try:
        listener = socket.create_server(address, backlog=options.clients)
    except OSError as error:
        raise InputError(f"port={options.port}: {error.strerror}; name another port") from None
    with listener, ProcessPool(options.clients, "clients") as pool:
        host, port = listener.getsockname()[:2]
        print(f"listening on {host}:{port} for Donkeycar clients; Ctrl-C ends", flush=True)
        listener.settimeout(LOOK_S)
        running: dict[int, socket.socket] = {}
        while True:
            for number, _ in pool.finished(0):
                running.pop(number).close()
            try:
                connection, peer = listener.accept()
            except TimeoutError:
                continue
            name = f"{peer[0]}:{peer[1]}"
            if len(running) >= options.clients:
                connection.close()
                print(
                    f"client {name}: refused, {options.clients} drive already; see clients=",
                    flush=True,
                )
                continue
            running[pool.submit(serve_client, connection, options, name)] = connection

"""The server of `drivezoo simulator serve`: the embedded world on a Donkeycar simulator's port."""

import json
import math
import re
import socket
import time
import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, suppress
from pathlib import Path

from zoo.base.errors import InputError
from zoo.base.process_pool import ProcessPool
from zoo.base.rig import RIGS, Rig
from zoo.base.rig_file import RIG_NAME, find_rig, write_rig
from zoo.extras.donkey.donkey_session import RATE, DonkeySession, Message, track_of
from zoo.extras.donkey.serve_options import ServeOptions
from zoo.simulator.track_file import read_track

MOST_BYTES = 65_536  # of one message
RECEIVED_BYTES = 4096  # at a time; a client of 50 controls in a frame sends more
SLOW_S = 5.0  # for a client to take a message
MENU_S = 20.0  # for a client to choose a scene
MOST_NOTES = 50  # lines about one client
LOOK_S = 0.2
# A text, which may have braces inside and may end later, or a brace.
TOKEN = re.compile(rb'"(?:[^"\\]|\\.)*(?:"|\\?\Z)|[{}]', re.DOTALL)


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
            end = _end_of_object(self._text)
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


def _end_of_object(text: bytes) -> int:
    depth = 0
    for token in TOKEN.finditer(text):
        depth += {b"{": 1, b"}": -1}.get(token[0], 0)
        if not depth:
            return token.end()
    return 0


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
    lockstep, notes = options.rate == "max", 0

    def note_some(line: str) -> None:
        nonlocal notes
        notes += 1
        if notes <= MOST_NOTES:
            note(line if notes < MOST_NOTES else f"{line}; further lines are left out")

    def send(messages: Iterable[Message]) -> None:
        connection.settimeout(SLOW_S)
        for message in messages:
            connection.sendall(json.dumps(message).encode() + b"\n")

    rate = RATE if lockstep else float(options.rate)
    session = DonkeySession(options.scene, rate, lockstep, options.renderer, note_some)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    stream, due_s, menu_s = MessageStream(), time.monotonic(), time.monotonic()
    rig: Rig | None = None
    with closing(session):
        send([session.greeting])
        while not session.ended:
            if session.world is not None and session.rig != rig:
                rig = session.rig
                note(rig_line(rig, options.tub))
            is_due = session.world is not None and not session.waits
            connection.settimeout(max(due_s - time.monotonic(), 1e-4) if is_due else MENU_S)
            try:
                received = connection.recv(RECEIVED_BYTES)
            except (TimeoutError, BlockingIOError):
                pass
            else:
                if not received:
                    return
                for message in stream.split(received):
                    send(session.answer(message))
                if is_due and len(received) == RECEIVED_BYTES:  # a flood gets no more of the time
                    time.sleep(max(due_s - time.monotonic(), 0))
            if session.world is not None:
                menu_s = time.monotonic()
            elif time.monotonic() - menu_s >= MENU_S:
                raise InputError(f"chose no scene in {MENU_S:.0f} s")
            world = session.world
            if world is not None and not session.waits and time.monotonic() >= due_s:
                # Of a frame that comes late, the delay is not caught up.
                due_s = max(due_s + world.frame_s, time.monotonic())
                send(session.advance(world))


def rig_line(rig: Rig, tub: str | None) -> str:
    """Return which rig a client's recording has; write it into the folder of its tub."""
    if tub is None:
        if rig == RIGS[rig.name]:
            return f"read its recordings with data.rig={rig.name}"
        return f"it has a camera of its own; tub=FOLDER writes its {RIG_NAME}"
    try:
        folder = Path(tub).expanduser()
        folder.mkdir(parents=True, exist_ok=True)
        if (other := find_rig(folder)) and other.name != rig.name:
            return f"{folder / RIG_NAME}: is of another car, {other.name}, and stays"
        write_rig(folder, rig)
    except (OSError, InputError, RuntimeError) as error:  # the last one for ~ of no user
        return f"tub={tub}: no {RIG_NAME} is written ({error})"
    return f"wrote {folder / RIG_NAME}"


def serve_clients(options: ServeOptions) -> None:
    """Serve clients until Ctrl-C, each in a process of its own.

    Raises:
        InputError: the port is taken, or there is no such scene.
    """
    if options.scene is not None:
        read_track(track_of(options.scene))  # now, for a message about it
    address = options.host, options.port
    try:
        family = socket.getaddrinfo(*address, type=socket.SOCK_STREAM)[0][0]
        listener = socket.create_server(address, family=family, backlog=options.clients)
    except OSError as error:
        reason = str(error.strerror).partition(" (")[0]  # without the address, in Python's words
        raise InputError(f"host={address[0]} port={address[1]}: {reason}; try another") from None
    with listener, ProcessPool(options.clients, "clients") as pool:
        host, port = listener.getsockname()[:2]
        print(f"listening on {host}:{port} for Donkeycar clients; Ctrl-C ends", flush=True)
        listener.settimeout(LOOK_S)
        running: dict[int, socket.socket] = {}
        refused_s = -math.inf
        while True:
            for number, _ in pool.finished(0):
                running.pop(number).close()
            try:
                connection, peer = listener.accept()
            except (TimeoutError, ConnectionAbortedError):
                continue
            name = f"{peer[0]}:{peer[1]}"
            if len(running) >= options.clients:
                connection.close()
                if time.monotonic() - refused_s >= 1:  # a line a second, of thousands of clients
                    refused_s = time.monotonic()
                    reason = f"refused, {options.clients} drive already; see clients="
                    print(f"client {name}: {reason}", flush=True)
                continue
            running[pool.submit(serve_client, connection, options, name)] = connection

"""`drivezoo simulator client` with hostile servers, or servers that are not drivers."""

import contextlib
import socket
import struct
import sys
import threading
import time
from collections.abc import Callable

import engineio
import pytest
from rich.console import Console

from tests.zoo.simulator.drivers import OPEN, Listening, handshake_answer, make_frame
from zoo.simulator import client as client_module
from zoo.simulator.client import Client
from zoo.simulator.command_options import ClientOptions
from zoo.simulator.legacy_socket import MAX_MESSAGE, OPENED, HandshakeSilentError, LegacySocket
from zoo.simulator.modern_socket import ModernSocket
from zoo.simulator.simulated_world import open_world

SEND_MOST = 64 << 20  # bytes that a hostile server sends at most


class Serving(Listening):
    """A server whose function `talk` handles each connection."""

    def __init__(self, talk: Callable[[socket.socket], None]) -> None:
        self._talk = talk


def shake_hands(connection: socket.socket) -> None:
    request = b""
    while not request.endswith(b"\r\n\r\n"):
        request += connection.recv(4096)
    connection.sendall(handshake_answer(request))


def wait(connection: socket.socket) -> None:
    """Read without an answer."""
    while connection.recv(1 << 16):
        pass


def trickle(connection: socket.socket) -> None:
    """Send an endless response head, byte by byte."""
    connection.sendall(b"HTTP/1.1 101 Switching Protocols\r\nX: ")
    for _ in range(600):
        connection.sendall(b"x")
        time.sleep(0.02)


def open_and(send: Callable[[socket.socket], None]) -> Callable[[socket.socket], None]:
    def talk(connection: socket.socket) -> None:
        shake_hands(connection)
        connection.sendall(make_frame(OPEN))
        send(connection)

    return talk


def endless_frame(length: int, opcode: int = 1) -> Callable[[socket.socket], None]:
    def send(connection: socket.socket) -> None:
        connection.sendall(bytes([0x80 | opcode, 127]) + struct.pack(">Q", length))
        for _ in range(SEND_MOST >> 16):
            connection.sendall(b"a" * (1 << 16))
        wait(connection)

    return send


def endless_fragments(connection: socket.socket) -> None:
    connection.sendall(b"\x01\x01a")
    for _ in range(SEND_MOST >> 15):
        connection.sendall(b"\x00\x7e" + struct.pack(">H", 1 << 15) + b"a" * (1 << 15))
    wait(connection)


TOO_LONG = {
    "a frame of 1 TB": endless_frame(1 << 40),
    "a binary frame of 1 TB": endless_frame(1 << 40, 2),
    "a PING of 1 TB": endless_frame(1 << 40, 9),
    "a frame of 2 MB": endless_frame(2 << 20),
    "a message without an end": endless_fragments,
}


def first_events(link: LegacySocket | ModernSocket, seconds: float = 10) -> None:
    ends = time.monotonic() + seconds
    while time.monotonic() < ends:
        link.events(0.25)
    raise AssertionError("the connection was kept")


@pytest.mark.parametrize("name", TOO_LONG)
def test_a_message_beyond_the_limit_ends_the_connection(name: str) -> None:
    with Serving(open_and(TOO_LONG[name])) as server:
        link = LegacySocket(server.url)
        with contextlib.closing(link), pytest.raises(ConnectionError, match=f"{MAX_MESSAGE:,}"):
            first_events(link)


@pytest.mark.parametrize("late", [False, True], ids=["at once", "before connect() returns"])
def test_the_modern_socket_has_the_same_limit(late: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    class LateEvent(threading.Event):
        def wait(self, timeout: float | None = None) -> bool:
            woken = super().wait(timeout)
            time.sleep(0.5)  # meanwhile, the frame ends the connection
            return woken

    def send(connection: socket.socket) -> None:
        connection.recv(4096)
        connection.sendall(make_frame('40{"sid":"y"}'))
        endless_frame(1 << 40)(connection)

    if late:
        monkeypatch.setattr(engineio.Client, "create_event", lambda _: LateEvent())
    with Serving(open_and(send)) as server:
        link = ModernSocket(server.url)
        with pytest.raises(ConnectionError):
            first_events(link)


@pytest.mark.parametrize("flood", [b"\x01\x7e\xff\xff", b"\x89\x00" * 100], ids=["frame", "PINGs"])
def test_a_message_without_an_end_does_not_block_the_client(flood: bytes) -> None:
    def send(connection: socket.socket) -> None:
        for _ in range(2_000):
            connection.sendall(flood)
            time.sleep(0.002)
            if flood[0] == 1:
                break
        for _ in range(500):
            connection.sendall(b"a")
            time.sleep(0.01)

    with Serving(open_and(send)) as server, contextlib.closing(LegacySocket(server.url)) as link:
        assert link.events(2) == [(OPENED, None)]
        calls = 0
        for _ in range(3):  # without a limit, none of them returns while bytes arrive
            calls += link.events(0.1) == []
    assert calls == 3


# --- Handshakes without an answer ---


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (LegacySocket, ModernSocket):
        monkeypatch.setattr(sys.modules[module.__module__], "HANDSHAKE_S", 0.3)
    monkeypatch.setattr(client_module, "SILENT_S", 0.3)
    monkeypatch.setattr(client_module, "RETRY_S", 0.01)


@pytest.mark.usefixtures("impatient")
@pytest.mark.parametrize("talk", [wait, trickle])
@pytest.mark.parametrize("kind", [LegacySocket, ModernSocket])
def test_a_handshake_without_an_answer_is_given_up(kind: type, talk: Callable) -> None:
    with Serving(talk) as server, pytest.raises(HandshakeSilentError):
        kind(server.url)


RUBBISH = ("0", "0[]", "0{}", "hello", '0{"sid":1,"upgrades":2}')


@pytest.mark.usefixtures("impatient")
@pytest.mark.parametrize(
    ("sent", "error"),
    [(OPEN, HandshakeSilentError), ("", HandshakeSilentError)]
    + [(rubbish, ConnectionError) for rubbish in RUBBISH],
)
def test_a_modern_session_that_is_not_opened_is_given_up(sent: str, error: type) -> None:
    def talk(connection: socket.socket) -> None:
        shake_hands(connection)
        if sent:
            connection.sendall(make_frame(sent))
        wait(connection)

    with Serving(talk) as server, pytest.raises(error):
        ModernSocket(server.url)


@pytest.mark.usefixtures("impatient")
def test_it_warns_once_and_connects_again(console: Console) -> None:
    connections = []

    def talk(connection: socket.socket) -> None:
        connections.append(connection)
        if len(connections) == 3:
            shake_hands(connection)  # and no OPEN packet
        wait(connection)

    with Serving(talk) as server:
        options = ClientOptions(url=server.url)
        client = Client(open_world("lake", quality="simple"), options, console)
        for _ in range(2):
            client.run()
        threading.Timer(1, lambda: connections[2].shutdown(socket.SHUT_RDWR)).start()
        client.run()
    printed = console.file.getvalue()
    assert printed.count("no answer to the handshake") == 1
    assert server.url in printed
    assert "another program on the port" in printed
    assert len(connections) == 3

"""The memory of `drivezoo drive`: `python benchmarks/driver_memory.py NAME ...`, a function each.

`traffic` is that of the original's client. Each of the nine attacks sends what a hostile client
may, over connections that it leaves open. The network has random weights.
"""

import contextlib
import json
import os
import re
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import psutil

from benchmarks.driver import noise_telemetry, random_checkpoint
from benchmarks.measuring import print_table, run_named
from simulator.legacy_socket import OPENED, LegacySocket
from simulator.telemetry import make_telemetry

MESSAGES, FPS = 72_000, 60
MOST_GROWTH_MB = 100
LEAST_ANSWERED = 0.9  # share of a genuine client's telemetry
SETTLE_S = 2.0  # pause before the first and the last reading of memory
EVERY_S = 2.0  # between a genuine client and the next
MOST_OPEN = 500  # connections that an attack holds at a time; the driver allows 512
LARGE_S = 0.1  # pause between large messages: 10 per second, 21 MB/s
POLLING = b"GET /socket.io/?EIO=4&transport=polling HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
POST = (
    b"POST /socket.io/?EIO=4&transport=polling&sid=%s HTTP/1.1\r\nHost: 127.0.0.1\r\n"
    b"Content-Length: %d\r\n\r\n"
)
WEBSOCKET = (
    b"GET /socket.io/?EIO=4&transport=websocket HTTP/1.1\r\nHost: 127.0.0.1\r\n"
    b"Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
    b"Sec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==\r\n\r\n"
)
LARGE = 2 << 20  # bytes; the longest message that the driver reads
BINARY, TEXT = 2, 1  # opcodes


class Attacker:
    """Connections to a driver; beyond `MOST_OPEN` the oldest are closed.

    Args:
        port: port of the driver on this machine.
    """

    def __init__(self, port: int) -> None:
        self.port = port
        self._open: deque[socket.socket] = deque()

    def connect(self, sent: bytes) -> socket.socket:
        """Open a connection, send the beginning of a request, and leave it open."""
        if len(self._open) >= MOST_OPEN:
            self._open.popleft().close()
        connection = socket.create_connection(("127.0.0.1", self.port), 5)
        self._open.append(connection)
        connection.sendall(sent)
        return connection

    def websocket(self) -> socket.socket:
        """Open a WebSocket and leave it open."""
        connection = self.connect(WEBSOCKET)
        answer = b""
        while b"\r\n\r\n" not in answer:
            more = connection.recv(4096)
            if not more:
                raise ConnectionError("the driver closed the connection")
            answer += more
        return connection

    def ask(self, request: bytes) -> bytes:
        """Return the answer to a request."""
        with socket.create_connection(("127.0.0.1", self.port), 5) as connection:
            connection.sendall(request)
            answer = b""
            while more := connection.recv(4096):
                answer += more
            return answer

    def close(self) -> None:
        """Close all connections."""
        for connection in self._open:
            connection.close()


def frame(opcode: int, size: int, sent: bytes) -> bytes:
    """Return the beginning of a WebSocket frame that announces `size` bytes, under a mask of 0."""
    head = struct.pack("!BBQ", 0x80 | opcode, 0xFF, size) if size > 65535 else None
    head = head or struct.pack("!BBH", 0x80 | opcode, 0xFE, size)
    return head + bytes(4) + sent


def handshakes(attacker: Attacker) -> float:
    """Open a polling session and leave it open."""
    attacker.ask(POLLING)
    return 0.0


def half_open(attacker: Attacker) -> float:
    """Send half of a request's head."""
    attacker.connect(b"GET / HT")
    return 0.0


def quiet(attacker: Attacker) -> float:
    """Open a WebSocket and send nothing."""
    attacker.websocket()
    return 0.0


def half_sent(attacker: Attacker) -> float:
    """Send all but the last byte of the longest message."""
    attacker.websocket().sendall(frame(TEXT, LARGE, b"4" * (LARGE - 1)))
    return LARGE_S


def after_telemetry(attacker: Attacker) -> float:
    """Send a telemetry, and all but the last byte of the longest message after it."""
    connection = attacker.websocket()
    connection.sendall(frame(TEXT, 400, b'42["telemetry",{}]'.ljust(400)))
    connection.sendall(frame(TEXT, LARGE, b"4" * (LARGE - 1)))
    return LARGE_S


def whole(attacker: Attacker) -> float:
    """Send the longest message, and nothing more."""
    attacker.websocket().sendall(frame(TEXT, LARGE, b'42["x","' + b"y" * (LARGE - 10) + b'"]'))
    return LARGE_S


def lists(attacker: Attacker) -> float:
    """Send a message that takes 20 times its size in memory when parsed."""
    text = b'42["telemetry"' + b",[]" * (LARGE // 3 - 10) + b"]"
    attacker.websocket().sendall(frame(TEXT, len(text), text))
    return LARGE_S


def attachments(attacker: Attacker) -> float:
    """Send one of two large attachments of a telemetry."""
    connection = attacker.websocket()
    connection.sendall(frame(TEXT, 400, b'452-["telemetry",{}]'.ljust(400)))
    size = LARGE - 1000
    connection.sendall(frame(BINARY, size, bytes(size)))
    return LARGE_S


def half_posts(attacker: Attacker) -> float:
    """Send all but the last byte of the longest polling request."""
    sid = json.loads(attacker.ask(POLLING).partition(b"\r\n\r\n")[2][1:])["sid"]
    attacker.connect(POST % (sid.encode(), LARGE) + b"4" * (LARGE - 1))
    return LARGE_S


# Each makes one request and returns the smallest pause before the next, in seconds.
ATTACKS: dict[str, Callable[[Attacker], float]] = {
    "polling handshakes": handshakes,
    "half-open connections": half_open,
    "half-sent messages": half_sent,
    "half-sent after telemetry": after_telemetry,
    "half-sent polling requests": half_posts,
    "whole large messages": whole,
    "lists of 20 times their size": lists,
    "missing attachments": attachments,
    "quiet WebSockets": quiet,
}


class Genuine(threading.Thread):
    """A simulator's client that counts the driver's answers.

    Args:
        port: port of the driver.
        steady: whether it keeps its connection; otherwise it connects for each telemetry.
    """

    def __init__(self, port: int, steady: bool) -> None:
        super().__init__(daemon=True)
        self.sent = self.answered = 0
        self.ended = threading.Event()
        self._url, self._steady = f"http://127.0.0.1:{port}", steady
        image = np.full((160, 320, 3), 99, np.uint8)
        self._message = make_telemetry(image, 0.0, 0.0, 9.0, False)

    def run(self) -> None:
        client = None
        while not self.ended.is_set():
            self.sent += 1
            try:
                client = client or LegacySocket(self._url)
                self.answered += self._answered(client)
            except OSError:
                client = None
            if client is not None and not self._steady:
                client.close()
                client = None
            self.ended.wait(0.1 if self._steady else EVERY_S)

    def _answered(self, client: LegacySocket) -> bool:
        client.emit("telemetry", self._message)
        ends = time.monotonic() + 10
        while (left_s := ends - time.monotonic()) > 0:
            # A reply to telemetry has an argument; the first message to a new client has none.
            if any(name != OPENED and argument for name, argument in client.events(left_s)):
                return True
        return False

    @property
    def is_served(self) -> bool:
        """Whether the driver answered nearly all messages."""
        return self.answered >= LEAST_ANSWERED * self.sent


def megabytes(process: psutil.Process) -> float:
    """Return the resident memory of a process."""
    return process.memory_info().rss / 1e6


@contextlib.contextmanager
def started_driver() -> Iterator[tuple[psutil.Process, int]]:
    """Start a process of `zoo.drive`; yield it and its port."""
    environ = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path), "OMP_NUM_THREADS": "1"}
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "zoo.drive", random_checkpoint(Path(folder)), "port=0"]
        with subprocess.Popen(
            command, stdout=subprocess.PIPE, text=True, cwd=folder, env=environ
        ) as process:
            try:
                found = (re.search(r"http://127\.0\.0\.1:(\d+)", line) for line in process.stdout)
                port = next(int(match[1]) for match in found if match)
                threading.Thread(target=process.stdout.read, daemon=True).start()
                yield psutil.Process(process.pid), port
                process.send_signal(signal.SIGINT)
                with contextlib.suppress(subprocess.TimeoutExpired):
                    process.wait(10)
            finally:
                process.kill()


def attack(name: str, seconds: float, rate: float) -> tuple[list[str], bool]:
    """Attack a driver; return its line of the table, and whether it withstood.

    It withstands if it grows little and answers one client that drives throughout, and others that
    connect during the attack.
    """
    with started_driver() as (process, port):
        genuine = [Genuine(port, True), Genuine(port, False)]
        for client in genuine:
            client.start()
        time.sleep(SETTLE_S)
        before = peak = megabytes(process)
        attacker, requests = Attacker(port), 0
        ends = time.monotonic() + seconds
        while (began := time.monotonic()) < ends:
            wait_s = 1 / rate
            # A driver may close the connection, as it should.
            with contextlib.suppress(OSError, ValueError):
                wait_s = max(wait_s, ATTACKS[name](attacker))
            requests += 1
            peak = max(peak, megabytes(process))
            time.sleep(max(began + wait_s - time.monotonic(), 0))
        for client in genuine:
            client.ended.set()
            client.join(20)
        attacker.close()
        time.sleep(SETTLE_S)
        sizes = (before, peak, megabytes(process), peak - before)
    cells = [name, f"{seconds:g}", f"{requests:,}", *(f"{size:.0f}" for size in sizes)]
    cells += [f"{client.answered:,} of {client.sent:,}" for client in genuine]
    return cells, sizes[-1] < MOST_GROWTH_MB and all(client.is_served for client in genuine)


def attacks(seconds: str = "600", rate: str = "100", only: str | None = None) -> int:
    """Measure drivers under attack: `attacks [seconds=600] [rate=100] [only=NAME]`.

    It starts a driver process for each attack, all at the same time, and attacks each from one
    thread with at most `rate` requests per second. It returns 1 if a driver grew too much or left a
    genuine client unanswered.
    """
    if only not in (None, *ATTACKS):
        sys.exit(f"only={only}: no such attack; available: {', '.join(ATTACKS)}")
    names = [only] if only else list(ATTACKS)
    # A process for each attacker, because threads of one process would wait for each other.
    with ProcessPoolExecutor(len(names), get_context("spawn")) as pool:
        jobs = [pool.submit(attack, name, float(seconds), float(rate)) for name in names]
        found = [job.result() for job in jobs]
    head = ["attack", "seconds", "requests", "before MB", "peak MB", "after MB", "growth MB"]
    print_table([*head, "steady client", "new clients"], [cells for cells, _ in found])
    return int(not all(withstood for _, withstood in found))


def traffic(messages: str = str(MESSAGES)) -> None:
    """Measure a driver's memory with the original's client: `traffic [MESSAGES]`.

    Its two loops send each frame twice, and the next one as soon as it is answered: 72,000 messages
    are what the original sends in ten minutes at 60 frames per second. Needs Linux.
    """
    telemetry, rows = noise_telemetry(200), []
    per_minute = 2 * 60 * FPS
    answered, following = 0, 0
    with started_driver() as (process, port):
        client = LegacySocket(f"http://127.0.0.1:{port}")
        while True:
            if answered >= following or answered >= int(messages):
                memory = process.memory_info()
                sizes = [memory.rss / 1e6, (memory.rss - memory.shared) / 1e6]
                cells = [f"{answered:,}", f"{answered / per_minute:.1f}"]
                rows.append([*cells, *(f"{size:.0f}" for size in sizes)])
                following = answered + min(max(answered, 2), per_minute)
            if answered >= int(messages):
                break
            if not answered:
                for _ in range(2):
                    client.emit("telemetry", telemetry[0])
            for name, _ in client.events(1.0):
                if name != OPENED:
                    answered += 1
                    client.emit("telemetry", telemetry[answered // 2 % len(telemetry)])
        client.close()
    print_table(["messages", "minutes of the original", "memory, MB", "without files, MB"], rows)


if __name__ == "__main__":
    run_named(attacks, traffic)

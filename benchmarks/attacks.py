"""Measure the driver's memory under attack: `benchmarks/attacks.py [seconds=600] [rate=100]`.

It starts a driver process for each attack, all at the same time, and attacks each from one thread
with at most `rate` requests per second. One genuine client drives throughout, and another connects
every two seconds; the driver must answer both. The driver's memory is its resident set.
"""

import contextlib
import json
import math
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
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import psutil
import torch
from rich.console import Console
from rich.table import Table

from datamodules.view import View
from simulator.command_line import read_options
from simulator.errors import SimulatorError
from simulator.legacy_socket import OPENED, LegacySocket
from simulator.telemetry import make_telemetry
from zoo.checkpoints.checkpoint import make_card
from zoo.models.make_network import make_network

MOST_GROWTH_MB = 100
LEAST_ANSWERED = 0.9  # share of a genuine client's telemetry
MOST_OPEN = 500  # connections that an attack holds at a time; the driver allows 512
LARGE_S = 0.1  # pause between large messages: 10 per second, 21 MB/s
SETTLE_S = 2.0  # pause before the first and the last reading of memory
EVERY_S = 2.0  # between a genuine client and the next
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


@dataclass(frozen=True)
class AttackOptions:
    """Options of the attacks.

    Args:
        seconds: duration of each attack; all run at the same time.
        rate: largest number of requests per second of each attack.
        only: name of one attack; null for all.
    """

    seconds: float = 600.0
    rate: float = 100.0
    only: str | None = None


@dataclass(frozen=True)
class Measured:
    """The figures of an attack.

    Attributes:
        requests: requests and connections of the attack.
        before: megabytes of the driver before the attack.
        peak: largest megabytes of the driver during the attack.
        after: megabytes of the driver after all connections are closed.
        steady: telemetry (answered, sent) of the client that drives throughout.
        late: telemetry (answered, sent) of the clients that connect during the attack.
    """

    requests: int
    before: float
    peak: float
    after: float
    steady: tuple[int, int]
    late: tuple[int, int]

    @property
    def withstood(self) -> bool:
        """Return whether the driver grew little and answered genuine clients."""
        served = (answered >= LEAST_ANSWERED * sent for answered, sent in (self.steady, self.late))
        return self.peak - self.before < MOST_GROWTH_MB and all(served)


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

    def end(self) -> tuple[int, int]:
        """Stop, and return the numbers of answered and sent messages."""
        self.ended.set()
        self.join(20)
        return self.answered, self.sent


def measure_attack(
    process: psutil.Process, port: int, name: str, options: AttackOptions
) -> Measured:
    """Attack a driver and return its figures."""
    genuine = [Genuine(port, True), Genuine(port, False)]
    for client in genuine:
        client.start()
    time.sleep(SETTLE_S)
    before = peak = megabytes(process)
    attacker, requests = Attacker(port), 0
    ends = time.monotonic() + options.seconds
    while (began := time.monotonic()) < ends:
        wait_s = 1 / options.rate
        with contextlib.suppress(
            OSError, ValueError
        ):  # the driver closed the connection, as it should
            wait_s = max(wait_s, ATTACKS[name](attacker))
        requests += 1
        peak = max(peak, megabytes(process))
        time.sleep(max(began + wait_s - time.monotonic(), 0))
    answered = [client.end() for client in genuine]
    attacker.close()
    time.sleep(SETTLE_S)
    return Measured(requests, before, peak, megabytes(process), *answered)


def megabytes(process: psutil.Process) -> float:
    """Return the resident memory of a process."""
    return process.memory_info().rss / 1e6


@contextlib.contextmanager
def driver(checkpoint: Path) -> Iterator[tuple[psutil.Process, int]]:
    """Start a process of `zoo.drive`; yield it and its port."""
    command = [sys.executable, "-m", "zoo.drive", str(checkpoint), "drive.port=0"]
    environ = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path), "OMP_NUM_THREADS": "1"}
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, text=True, cwd=checkpoint.parent, env=environ
    ) as process:
        try:
            port = next(
                int(found[1])
                for line in process.stdout
                if (found := re.search(r"http://127\.0\.0\.1:(\d+)", line))
            )
            threading.Thread(target=process.stdout.read, daemon=True).start()
            yield psutil.Process(process.pid), port
            process.send_signal(signal.SIGINT)
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(10)
        finally:
            process.kill()


def attack(name: str, options: AttackOptions) -> Measured:
    """Start a driver, attack it, and return the figures."""
    with tempfile.TemporaryDirectory() as folder:
        checkpoint = write_checkpoint(Path(folder) / "random.ckpt")
        with driver(checkpoint) as (process, port):
            return measure_attack(process, port, name, options)


def write_checkpoint(path: Path) -> Path:
    """Write a network of random weights."""
    model = {"_target_": "zoo.models.linear.Linear", "name": "linear", "colour": "hsv_s"}
    model |= {"size": [1, 14], "weights": None}
    view = View([60, 40], model["colour"], model["size"])
    network = make_network(model, view)
    card = make_card({"model": model}, view, {"fingerprint": "0" * 16, "rows": 10})
    state = {f"network.{name}": one for name, one in network.state_dict().items()}
    torch.save({"drivezoo": card, "state_dict": state, "epoch": 0}, path)
    return path


def main(arguments: list[str]) -> int:
    """Print the table; return 1 if a driver grew too much or left a genuine client unanswered."""
    try:
        options = read_options(AttackOptions, arguments)
        if options.only not in (None, *ATTACKS):
            raise SimulatorError(
                f"only={options.only}: no such attack; available: {', '.join(ATTACKS)}"
            )
        for key in ("seconds", "rate"):
            if not 0 < (value := getattr(options, key)) < math.inf:
                raise SimulatorError(f"{key}={value:g}: must be above 0")
    except SimulatorError as error:
        print(f"attacks: {error}", file=sys.stderr)
        return 1
    names = [options.only] if options.only else list(ATTACKS)
    # A process for each attacker, because threads of one process would wait for each other.
    with ProcessPoolExecutor(len(names), get_context("spawn")) as pool:
        found = list(pool.map(attack, names, [options] * len(names)))
    columns = ("attack", "seconds", "requests", "before MB", "peak MB", "after MB", "growth MB")
    table = Table(*columns, "steady client", "new clients")
    for name, one in zip(names, found, strict=True):
        sizes = (one.before, one.peak, one.after, one.peak - one.before)
        shares = [f"{answered:,} of {sent:,}" for answered, sent in (one.steady, one.late)]
        figures = (f"{options.seconds:g}", f"{one.requests:,}", *(f"{mb:.0f}" for mb in sizes))
        table.add_row(name, *figures, *shares)
    Console(width=150).print(table)
    return int(not all(one.withstood for one in found))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

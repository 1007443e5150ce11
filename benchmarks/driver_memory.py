"""The memory of `drivezoo drive`: `python benchmarks/driver_memory.py NAME ...`, a function each.

`traffic` is that of the original's client. `attack` sends what a hostile client may, over
connections that it leaves open. The network has random weights.
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
from pathlib import Path

import psutil

from benchmarks.driver import FPS, noise_telemetry
from benchmarks.measuring import print_table, run_named
from simulator.legacy_socket import OPENED, LegacySocket

MESSAGES = 72_000
MOST_GROWTH_MB = 100
MOST_OPEN = 500  # connections that an attack holds at a time; the driver allows 512
EVERY_S = 0.1  # pause between messages: 10 per second, 21 MB/s
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


def half_post(attacker: Attacker) -> None:
    """Send all but the last byte of the longest polling request."""
    sid = json.loads(attacker.ask(POLLING).partition(b"\r\n\r\n")[2][1:])["sid"]
    attacker.connect(POST % (sid.encode(), LARGE) + b"4" * (LARGE - 1))


HALF = frame(TEXT, LARGE, b"4" * (LARGE - 1))  # all but the last byte of the longest message
WHOLE = frame(TEXT, LARGE, b'42["x","' + b"y" * (LARGE - 10) + b'"]')
DRIVING = frame(TEXT, 400, b'42["telemetry",{}]'.ljust(400))
# One of two large attachments of a telemetry.
ATTACHED = frame(TEXT, 400, b'452-["telemetry",{}]'.ljust(400))
ATTACHED += frame(BINARY, LARGE - 1000, bytes(LARGE - 1000))
ATTACKS: dict[str, Callable[[Attacker], None]] = {
    "half-sent messages": lambda attacker: attacker.websocket().sendall(HALF),
    "half-sent after telemetry": lambda attacker: attacker.websocket().sendall(DRIVING + HALF),
    "half-sent polling requests": half_post,
    "whole large messages": lambda attacker: attacker.websocket().sendall(WHOLE),
    "missing attachments": lambda attacker: attacker.websocket().sendall(ATTACHED),
}


def megabytes(process: psutil.Process) -> float:
    """Return the resident memory of a process."""
    return process.memory_info().rss / 1e6


def random_checkpoint(folder: Path) -> str:
    """Write a checkpoint of nvidia with random weights; return its path."""
    import torch

    from benchmarks.material import random_network
    from zoo.checkpoints.checkpoint import PREFIX, make_card

    network, view, config = random_network("nvidia")
    weights = {f"{PREFIX}{key}": value for key, value in network.state_dict().items()}
    card = make_card(config, view, {"fingerprint": "0" * 16, "rows": 10})
    torch.save({"state_dict": weights, "drivezoo": card, "epoch": 0}, folder / "random.ckpt")
    return str(folder / "random.ckpt")


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


def attack(name: str, seconds: str = "600") -> int:
    """Measure a driver under attack: `attack NAME [seconds=600]`; return 1 if it grew too much."""
    if name not in ATTACKS:
        sys.exit(f"{name}: no such attack; available: {', '.join(ATTACKS)}")
    requests, ends = 0, time.monotonic() + float(seconds)
    with started_driver() as (process, port):
        attacker, before = Attacker(port), megabytes(process)
        peak = before
        while time.monotonic() < ends:
            # A driver may close the connection, as it should.
            with contextlib.suppress(OSError, ValueError):
                ATTACKS[name](attacker)
            requests, peak = requests + 1, max(peak, megabytes(process))
            time.sleep(EVERY_S)
        attacker.close()
    figures = [f"{size:.0f}" for size in (before, peak, peak - before)]
    head = ["attack", "requests", "before MB", "peak MB", "growth MB"]
    print_table(head, [[name, f"{requests:,}", *figures]])
    return int(peak - before > MOST_GROWTH_MB)


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
    run_named(attack, traffic)

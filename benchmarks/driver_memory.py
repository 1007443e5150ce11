"""The memory of `drivezoo drive`: `python benchmarks/driver_memory.py NAME ...`, a function each.

`traffic` is that of the original's client. `attack` sends what a hostile client may, over
connections that it leaves open. The network is one that comes with drivezoo, of NVIDIA.
"""

import contextlib
import json
import os
import re
import socket
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from collections import deque
from collections.abc import Callable, Iterator

import psutil
import websocket
from websocket import ABNF

from benchmarks.driver import FPS, noise_telemetry
from benchmarks.measuring import print_table, run_named
from zoo.base.child_process import end_module, start_module
from zoo.simulator.legacy_socket import OPENED, LegacySocket

MESSAGES = 72_000
MOST_GROWTH_MB = 100
MOST_OPEN = 500  # connections that an attack holds at a time; the driver allows 512
EVERY_S = 0.1  # pause between messages: 10 per second, 21 MB/s
POST = (
    b"POST /socket.io/?EIO=4&transport=polling&sid=%s HTTP/1.1\r\nHost: 127.0.0.1\r\n"
    b"Content-Length: %d\r\n\r\n"
)
NETWORK = "pilotnet"
LARGE = 2 << 20  # bytes; the longest message that the driver reads


def message(text: str) -> bytes:
    """Return a text message of a WebSocket."""
    return ABNF.create_frame(text, ABNF.OPCODE_TEXT).format()


HALF = message("4" * LARGE)[:-1]
WHOLE = message('42["x","' + "y" * (LARGE - 10) + '"]')
DRIVING = message('42["telemetry",{}]')
# One of two large attachments of a telemetry.
ATTACHED = message('452-["telemetry",{}]')
ATTACHED += ABNF.create_frame(bytes(LARGE - 1000), ABNF.OPCODE_BINARY).format()


class Attacker:
    """Connections to a driver; beyond `MOST_OPEN` the oldest are closed.

    Args:
        port: port of the driver on this machine.
    """

    def __init__(self, port: int) -> None:
        self.port, self.url = port, f"://127.0.0.1:{port}/socket.io/?EIO=4&transport="
        self._open: deque[socket.socket] = deque()

    def connect(self, sent: bytes) -> socket.socket:
        """Open a connection, send the beginning of a request, and leave it open."""
        connection = self._keep(socket.create_connection(("127.0.0.1", self.port), 5))
        connection.sendall(sent)
        return connection

    def websocket(self) -> socket.socket:
        """Open a WebSocket and leave it open."""
        try:
            return self._keep(websocket.create_connection(f"ws{self.url}websocket", 5).sock)
        except websocket.WebSocketException as error:
            raise ConnectionError(str(error)) from None

    def half_post(self) -> None:
        """Send all but the last byte of the longest polling request."""
        with urllib.request.urlopen(f"http{self.url}polling", timeout=5) as answer:
            sid = json.loads(answer.read()[1:])["sid"]
        self.connect(POST % (sid.encode(), LARGE) + b"4" * (LARGE - 1))

    def close(self) -> None:
        """Close all connections."""
        for connection in self._open:
            connection.close()

    def _keep(self, connection: socket.socket) -> socket.socket:
        if len(self._open) >= MOST_OPEN:
            self._open.popleft().close()
        self._open.append(connection)
        return connection


ATTACKS: dict[str, Callable[[Attacker], None]] = {
    "half-sent messages": lambda attacker: attacker.websocket().sendall(HALF),
    "half-sent after telemetry": lambda attacker: attacker.websocket().sendall(DRIVING + HALF),
    "half-sent polling requests": Attacker.half_post,
    "whole large messages": lambda attacker: attacker.websocket().sendall(WHOLE),
    "missing attachments": lambda attacker: attacker.websocket().sendall(ATTACHED),
}


def megabytes(process: psutil.Process) -> float:
    """Return the resident memory of a process."""
    return process.memory_info().rss / 1e6


@contextlib.contextmanager
def started_driver() -> Iterator[tuple[psutil.Process, int]]:
    """Start a process of `zoo.commands.drive`; yield it and its port."""
    os.environ["OMP_NUM_THREADS"] = "1"
    output = {"stdout": subprocess.PIPE, "text": True}
    with tempfile.TemporaryDirectory() as folder:
        process = start_module("zoo.commands.drive", NETWORK, "port=0", cwd=folder, **output)
        try:
            found = (re.search(r"http://127\.0\.0\.1:(\d+)", line) for line in process.stdout)
            port = next(int(match[1]) for match in found if match)
            threading.Thread(target=process.stdout.read, daemon=True).start()
            yield psutil.Process(process.pid), port
        finally:
            end_module(process)


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

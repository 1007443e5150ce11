"""Measure the memory of `drivezoo drive`: `python benchmarks/driver_memory.py [MESSAGES]`.

A client with the original's two loops sends each frame twice, and the next one as soon as it is
answered: 72,000 messages are what the original sends in ten minutes at 60 frames per second. The
network is nvidia with random weights. Memory is read from /proc, so this needs Linux.
"""

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table
from scored_lap import random_checkpoint

from simulator.legacy_socket import OPENED, LegacySocket
from simulator.telemetry import make_telemetry
from zoo.drive.server import listen

MESSAGES, FRAMES = 72_000, 200
PER_MINUTE = 2 * 60 * 60  # of two loops at 60 frames per second
START_S = 300.0


def memory_mb(pid: int) -> tuple[float, float]:
    """Return a process's resident memory and the part without files, in MB."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    values = dict(line.split(":", 1) for line in lines)
    resident, own = (int(values[key].split()[0]) / 1e3 for key in ("VmRSS", "RssAnon"))
    return resident, own


def connect(port: int, log: Path) -> LegacySocket:
    """Return a client, once the driver listens."""
    end = time.monotonic() + START_S
    while "listening on" not in log.read_text():
        if time.monotonic() > end:
            raise SystemExit(
                f"driver_memory.py: no driver after {START_S:.0f} s\n{log.read_text()}"
            )
        time.sleep(0.1)
    return LegacySocket(f"http://127.0.0.1:{port}")


def measure_memory(folder: Path, messages: int) -> list[tuple[int, float, float]]:
    """Return the number of answered messages with the memory, more rarely as they grow."""
    with listen("127.0.0.1", 0) as free:
        port = free.getsockname()[1]
    log = folder / "log.txt"
    command = [sys.executable, "-m", "zoo.drive", random_checkpoint(folder), f"port={port}"]
    rng = np.random.default_rng(0)
    frames = [rng.integers(0, 255, (20, 40, 3)).repeat(8, 0).repeat(8, 1) for _ in range(FRAMES)]
    telemetry = [make_telemetry(frame.astype(np.uint8), 0.0, 0.0, 9.0, False) for frame in frames]
    with log.open("w") as output:
        driver = subprocess.Popen(command, cwd=folder, stdout=output, stderr=output)
    try:
        client, answered, following = connect(port, log), 0, 2
        found = [(0, *memory_mb(driver.pid))]
        for _ in range(2):
            client.emit("telemetry", telemetry[0])
        while answered < messages:
            for name, _ in client.events(1.0):
                if name != OPENED:
                    answered += 1
                    client.emit("telemetry", telemetry[answered // 2 % FRAMES])
            if answered >= following or answered >= messages:
                found.append((answered, *memory_mb(driver.pid)))
                following = answered + min(answered, PER_MINUTE)
        client.close()
        return found
    finally:
        driver.terminate()
        driver.wait(60)


def main(messages: int) -> None:
    """Print the table."""
    table = Table("messages", "minutes of the original", "memory, MB", "without files, MB")
    with tempfile.TemporaryDirectory() as folder:
        for answered, resident, own in measure_memory(Path(folder), messages):
            minutes = f"{answered / PER_MINUTE:.1f}"
            table.add_row(f"{answered:,}", minutes, f"{resident:.0f}", f"{own:.0f}")
    Console().print(table)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else MESSAGES)

"""Check of a round trip: a driver on a free port, and a client with the original's protocol."""

from __future__ import annotations

import re
import statistics
import subprocess
import tempfile
import threading
import time
from collections.abc import Iterator

from zoo.base.child_process import interrupt_module, start_module
from zoo.doctor.finding import FAULT, OK, Finding

TIMEOUT_S = 30.0
FRAMES = 20


def check_round_trip(checkpoint: str) -> Iterator[Finding]:
    """Start `drivezoo drive` with a checkpoint, and send it grey images."""
    what = "round trip"
    fix = f"start it yourself to see its output: drivezoo drive {checkpoint}"
    with tempfile.TemporaryDirectory() as folder:
        process = start_module(
            "zoo.drive",
            checkpoint,
            "drive.port=0",
            f"drive.record={folder}/drive",
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            encoding="utf-8",
            errors="replace",
        )
        try:
            url, last = _wait_for_url(process)
            if url is None:
                yield Finding(FAULT, what, f"the driver did not start, it printed: {last}", fix)
                return
            times_ms, steer = _drive(url)
            found = f"{FRAMES} images as the original sends them, each answered"
            took = f"{statistics.median(times_ms):.1f} ms"
            yield Finding(OK, what, f"{found} in {took} (median), steering {steer:+.3f}")
        except (OSError, ValueError, TimeoutError) as error:
            yield Finding(FAULT, what, f"the driver does not answer: {error}", fix)
        finally:
            _end(process)


def _drive(url: str) -> tuple[list[float], float]:
    """Return the milliseconds from each telemetry to its reply, and the last steering.

    Raises:
        TimeoutError: the driver sent no reply.
        ValueError: the original simulator would not accept the reply.
    """
    import numpy as np

    from simulator.legacy_socket import LegacySocket
    from simulator.rig import FRAME_HEIGHT, FRAME_WIDTH
    from simulator.telemetry import make_telemetry, read_steer

    frame = np.full((FRAME_HEIGHT, FRAME_WIDTH, 3), 128, np.uint8)
    client = LegacySocket(url)
    times_ms, steering = [], 0.0
    try:
        for _ in range(FRAMES):
            began = time.perf_counter()
            client.emit("telemetry", make_telemetry(frame, 0.0, 0.0, 9.0, decimal_comma=False))
            steering, _ = read_steer(_next_steer(client), decimal_comma=False)
            times_ms.append(1000 * (time.perf_counter() - began))
    finally:
        client.close()
    return times_ms, steering


def _next_steer(client: object) -> object:
    end_s = time.monotonic() + TIMEOUT_S / 3
    while time.monotonic() < end_s:
        for name, argument in client.events(0.2):
            if name == "steer":
                return argument
    raise TimeoutError("no steer event received")


def _wait_for_url(process: subprocess.Popen) -> tuple[str | None, str]:
    """Return the URL that the driver prints, None without one, and the last line."""
    timer = threading.Timer(TIMEOUT_S, process.kill)
    timer.start()
    last = "nothing"
    try:
        for line in process.stdout:
            last = line.strip() or last
            if found := re.search(r"listening on (http://\S+?)[;\s]", line):
                return found[1], last
    finally:
        timer.cancel()
    return None, last


def _end(process: subprocess.Popen) -> None:
    if process.poll() is None:
        interrupt_module(process)
    try:
        process.wait(5)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()

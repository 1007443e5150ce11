"""Measure the driver's memory under attack: `benchmarks/attacks.py [seconds=600] [rate=100]`.

It starts a driver process for each attack, all at the same time, and attacks each from one thread
with at most `rate` requests per second. One genuine client drives throughout, and another connects
every two seconds; the driver must answer both. The driver's memory is its resident set.
"""

import contextlib
import math
import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import psutil
import torch
from rich.console import Console
from rich.table import Table

from benchmarks.attacker import ATTACKS, Attacker
from datamodules.view import View
from simulator.command_line import read_options
from simulator.legacy_socket import OPENED, LegacySocket
from simulator.telemetry import make_telemetry
from zoo.base.errors import InputError
from zoo.checkpoints.checkpoint import make_card
from zoo.models.make_network import make_network

MOST_GROWTH_MB = 100
LEAST_ANSWERED = 0.9  # share of a genuine client's telemetry
SETTLE_S = 2.0  # pause before the first and the last reading of memory
EVERY_S = 2.0  # between a genuine client and the next


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
            raise InputError(
                f"only={options.only}: no such attack; available: {', '.join(ATTACKS)}"
            )
        for key in ("seconds", "rate"):
            if not 0 < (value := getattr(options, key)) < math.inf:
                raise InputError(f"{key}={value:g}: must be above 0")
    except InputError as error:
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

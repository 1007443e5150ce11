"""`drivezoo simulator serve` as a process."""

import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def donkey_simulator(*keys: str) -> Iterator[tuple[int, subprocess.Popen]]:
    """Start a server on a free port; yield the port and the process."""
    process = subprocess.Popen(
        [sys.executable, "-m", "zoo.commands.simulator", "serve", "port=0", *keys],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    assert process.stdout is not None
    line = process.stdout.readline()
    try:
        yield int(re.search(r":(\d+) ", line)[1]), process
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(30)

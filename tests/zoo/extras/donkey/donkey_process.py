"""`drivezoo simulator serve` as a process."""

import re
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.zoo.command_runs import start
from tests.zoo.forked_commands import ForkedProcess

Process = subprocess.Popen | ForkedProcess


@contextmanager
def donkey_simulator(*keys: str) -> Iterator[tuple[int, Process]]:
    """Start a server on a free port; yield the port and the process."""
    process = start(Path.cwd(), "zoo.commands.simulator", "serve", "port=0", *keys)
    assert process.stdout is not None
    line = process.stdout.readline()
    try:
        yield int(re.search(r":(\d+) ", line)[1]), process
    finally:
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=30)

"""Commands that drive in several processes, stopped at random moments: nothing is left behind."""

import os
import random
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest

from tests.zoo.commands import command, environment

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform == "win32", reason="sends POSIX signals"),
]

COMMANDS = {
    "benchmark": ("zoo.benchmark", "lenet", "suite=quick", "workers=2"),
    "evaluate": ("zoo.evaluate", "lenet", "seeds=4", "workers=2"),
    "guard": ("zoo.guard", "lenet", "workers=2"),
    "record": ("simulator", "record", "track=lake", "laps=3", "jobs=2"),
    "search": ("zoo.search", "lenet", "workers=2"),
}
HOW = {
    "Ctrl-C": (os.killpg, signal.SIGINT),
    "SIGINT": (os.kill, signal.SIGINT),
    "SIGTERM": (os.kill, signal.SIGTERM),
    "SIGKILL": (os.kill, signal.SIGKILL),
}


@pytest.mark.parametrize("how", HOW)
@pytest.mark.parametrize("name", COMMANDS)
def test_a_stopped_command_leaves_no_process(name: str, how: str, tmp_path: Path) -> None:
    send, number = HOW[how]
    process = subprocess.Popen(
        command(*COMMANDS[name], f"out={tmp_path / 'out'}"),
        cwd=tmp_path,
        env=environment(),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        time.sleep(random.uniform(2, 15))  # while it imports, starts processes, or drives
        send(process.pid, number)
        # The pipe of errors ends when the last process has ended.
        _, errors = process.communicate(timeout=60)
    finally:
        with suppress(ProcessLookupError):  # all have ended
            os.killpg(process.pid, signal.SIGKILL)
    lines = [line for line in errors.splitlines() if "comes with drivezoo" not in line]
    if number == signal.SIGINT:
        # Python itself ends by SIGINT, which a shell sees as 130, if it came during an import.
        assert process.returncode in (130, -signal.SIGINT)
        assert len(lines) == 1, errors
        assert ": stopped" in lines[0]
    else:
        assert process.returncode == -number
        assert lines == []

"""Running of our commands as a user does: in a process and a folder for each."""

import functools
import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.zoo.forked_commands import ForkedCommands

ROOT = Path(__file__).parents[2]


def environment() -> dict[str, str]:
    # One thread: the networks are small, and processes of several tests share the cores.
    return os.environ | {
        "PYTHONPATH": str(ROOT),
        "OMP_NUM_THREADS": "1",
        "CUDA_VISIBLE_DEVICES": "",
    }


def command(module: str, *arguments: str) -> list[str]:
    return [sys.executable, "-m", module, *arguments]


def run(
    cwd: Path, *arguments: str, module: str = "zoo", timeout: int = 120
) -> subprocess.CompletedProcess:
    """Return the output and exit status of `python -m zoo ARGUMENTS`."""
    if sys.platform != "linux":  # elsewhere, forking a process that has threads is not safe
        return subprocess.run(
            command(module, *arguments),
            cwd=cwd,
            env=environment(),
            capture_output=True,
            text=True,
            timeout=timeout,
            check=False,
        )
    with tempfile.NamedTemporaryFile("r") as output, tempfile.NamedTemporaryFile("r") as errors:
        files = Path(output.name), Path(errors.name)
        status = forked_commands().run([module, *arguments], cwd, environment(), timeout, *files)
        if status == -signal.SIGALRM:
            raise subprocess.TimeoutExpired([module, *arguments], timeout)
        return subprocess.CompletedProcess(arguments, status, output.read(), errors.read())


@functools.cache
def forked_commands() -> ForkedCommands:
    """Return the process that forks commands for all tests of this process."""
    return ForkedCommands(environment())


def only_line(result: subprocess.CompletedProcess) -> str:
    """Return the one error line of a command with bad input; fail on a traceback or status 0."""
    assert result.returncode in (1, 2), result.stdout + result.stderr
    lines = result.stderr.strip().splitlines()
    assert len(lines) == 1, result.stderr
    return lines[0]

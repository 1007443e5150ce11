"""Run our commands as a person does: in a process of their own, in a folder of their own."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def environment() -> dict[str, str]:
    # One thread: the networks are small, and several tests' processes share the cores.
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
    """What `python -m zoo ARGUMENTS` printed and its exit status."""
    return subprocess.run(
        command(module, *arguments),
        cwd=cwd,
        env=environment(),
        capture_output=True,
        text=True,
        timeout=timeout,
        check=False,
    )


def only_line(result: subprocess.CompletedProcess) -> str:
    """The one line that a command with bad input says; fails on a trace or an exit status of 0."""
    assert result.returncode == 1, result.stdout + result.stderr
    lines = result.stderr.strip().splitlines()
    assert len(lines) == 1, result.stderr
    return lines[0]

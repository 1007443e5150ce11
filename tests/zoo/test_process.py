"""The allocator and the waiting threads, in processes of their own."""

import os
import platform
import subprocess
import sys
from pathlib import Path

import pytest

# Takes and gives back the blocks of a training step, and says how often the kernel had to help.
STEPS = """
import resource, sys
from zoo.process import keep_freed_memory
if "keep" in sys.argv:
    assert keep_freed_memory()
for step in range(30):
    blocks = [bytearray(20_000_000) for _ in range(3)]
    blocks.clear()
    if step == 9:
        before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""
WAITING = """
import os
from zoo.process import wait_without_spinning
wait_without_spinning()
print(os.environ.get("OMP_WAIT_POLICY"))
"""


def run(code: str, *arguments: str, **environment: str) -> str:
    kept = {name: value for name, value in os.environ.items() if name != "OMP_WAIT_POLICY"}
    result = subprocess.run(
        [sys.executable, "-c", code, *arguments],
        env=kept | environment,
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        check=True,
    )
    return result.stdout.strip()


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="glibc alone gives memory back")
def test_freed_memory_is_kept() -> None:
    assert int(run(STEPS, "keep")) < 0.1 * int(run(STEPS))


def test_threads_sleep_while_they_wait() -> None:
    assert run(WAITING) == "PASSIVE"


def test_who_said_how_threads_wait_is_heeded() -> None:
    assert run(WAITING, OMP_WAIT_POLICY="ACTIVE") == "ACTIVE"
    assert run(WAITING, GOMP_SPINCOUNT="5000") == "None"

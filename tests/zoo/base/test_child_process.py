"""Commands that other commands start: they end with them, however those end."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.zoo.commands import ROOT, environment

CHILD = "import zoo, time; print('begun', flush=True); time.sleep(300)"
PARENT = f"""
import subprocess, sys
from zoo.base.child_process import child_environment
subprocess.run([sys.executable, "-c", {CHILD!r}], env=child_environment())
"""


@pytest.mark.skipif(sys.platform == "win32", reason="sends POSIX signals")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_a_command_ends_with_the_command_that_started_it(number: int) -> None:
    parent = subprocess.Popen(
        [sys.executable, "-c", PARENT], cwd=ROOT, env=environment(), stdout=subprocess.PIPE
    )
    assert parent.stdout.readline() == b"begun\n"
    parent.send_signal(number)
    # The pipe ends when the child has ended, too.
    assert parent.communicate(timeout=60)[0] == b""
    assert parent.returncode == -number


def test_a_process_that_another_one_started_is_left_alone(tmp_path: Path) -> None:
    """A variable that was inherited over a further process ends nothing."""
    quiet = "import zoo, time; time.sleep(1.5)"
    found = subprocess.run(
        [sys.executable, "-c", quiet],
        cwd=ROOT,
        env=environment() | {"DRIVEZOO_PARENT": "1"},
        check=False,
    )
    assert found.returncode == 0

"""Standard output that is full, closed, or a pipe whose reader ends: one line, or none."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.recordings import Written
from tests.zoo.commands import environment

FULL = Path("/dev/full")
SCRIPT = [sys.executable, "-c", "from zoo.cli.console_script import main; raise SystemExit(main())"]


def arguments(name: str, recorded: Written) -> list[str]:
    return [*SCRIPT, *{"check": ["check", str(recorded.folder)]}.get(name, name.split())]


COMMANDS = ["--help", "--version", "check", "check --help", "simulator --help", "list tracks"]


@pytest.mark.skipif(not FULL.exists(), reason="the system has no /dev/full")
@pytest.mark.parametrize("name", COMMANDS)
def test_a_full_disk_is_one_line(name: str, recorded: Written, tmp_path: Path) -> None:
    with FULL.open("w") as output:
        done = subprocess.run(
            arguments(name, recorded),
            stdout=output,
            stderr=subprocess.PIPE,
            text=True,
            cwd=tmp_path,
            env=environment(),
        )
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert "standard output: " in line


@pytest.mark.skipif(sys.platform == "win32", reason="the shell has no >&-")
@pytest.mark.parametrize("name", COMMANDS)
def test_a_closed_output_is_no_error(name: str, recorded: Written, tmp_path: Path) -> None:
    done = subprocess.run(
        ["sh", "-c", '"$@" >&-', "sh", *arguments(name, recorded)],
        stderr=subprocess.PIPE,
        text=True,
        cwd=tmp_path,
        env=environment(),
    )
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("name", COMMANDS)
def test_a_reader_that_ends_early_is_no_error(name: str, recorded: Written, tmp_path: Path) -> None:
    with subprocess.Popen(
        arguments(name, recorded),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=tmp_path,
        env=environment(),
    ) as process:
        assert process.stdout is not None
        process.stdout.close()
        _, errors = process.communicate()
    assert (process.returncode, errors) == (0, "")

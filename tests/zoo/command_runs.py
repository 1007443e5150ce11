"""Running of our commands as a user does: in a process and a folder for each."""

import contextlib
import functools
import io
import itertools
import os
import runpy
import signal
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from unittest import mock

import pytest

from tests.zoo.forked_commands import ForkedCommands, ForkedProcess

ROOT = Path(__file__).parents[2]
Zoo = Callable[..., subprocess.CompletedProcess]  # of the fixture
CAPTURED = {"capture_output": True, "text": True, "check": False}


def environment(code: Path = ROOT) -> dict[str, str]:
    # One thread: the networks are small, and processes of several tests share the cores.
    return os.environ | {
        "PYTHONPATH": os.pathsep.join(dict.fromkeys([str(code), str(ROOT)])),
        "OMP_NUM_THREADS": "1",
        "CUDA_VISIBLE_DEVICES": "",
    }


def command(module: str, *arguments: str) -> list[str]:
    """Return the words that start a module, or a script whose path ends with `.py`."""
    how = [] if module.endswith(".py") else ["-m"]
    return [sys.executable, *how, module, *arguments]


def run(
    cwd: Path,
    *arguments: str,
    module: str = "zoo",
    timeout: int = 120,
    code: Path = ROOT,
    threads: str = "1",
) -> subprocess.CompletedProcess:
    """Return the output and exit status of `drivezoo train ARGUMENTS`, of the project at `code`.

    `module` is another module, or the path of a script; `threads` is its OMP_NUM_THREADS.
    """
    variables = environment(code) | {"OMP_NUM_THREADS": threads}
    if sys.platform != "linux":  # elsewhere, forking a process that has threads is not safe
        words = command(module, *last_of_each(module, arguments))
        return subprocess.run(words, cwd=cwd, env=variables, timeout=timeout, **CAPTURED)
    with tempfile.NamedTemporaryFile("r") as output, tempfile.NamedTemporaryFile("r") as errors:
        files = Path(output.name), Path(errors.name)
        words = [module, *last_of_each(module, arguments)]
        pid = forked_commands(code).start(words, cwd, variables, timeout, *files)
        status = forked_commands(code).wait(pid)
        if status == -signal.SIGALRM:
            raise subprocess.TimeoutExpired([module, *arguments], timeout)
        return subprocess.CompletedProcess(arguments, status, output.read(), errors.read())


def run_here(cwd: Path, *arguments: str, module: str = "zoo") -> subprocess.CompletedProcess:
    """Return the output and exit status of `python -m MODULE ARGUMENTS`.

    It runs in this process, which has imported most of it: a process for each takes seconds. What
    it adds to the environment and to the import path ends with it.
    """
    printed = [io.TextIOWrapper(io.BytesIO(), "utf-8") for _ in range(2)]
    with (
        pytest.MonkeyPatch.context() as patch,
        mock.patch.dict(os.environ),
        warnings.catch_warnings(),
    ):
        warnings.simplefilter("ignore", RuntimeWarning)  # of runpy, for what was imported before
        patch.chdir(cwd)
        patch.setattr(sys, "path", [*sys.path])
        patch.setattr(sys, "argv", [module, *last_of_each(module, arguments)])
        status = 0
        try:
            with contextlib.redirect_stdout(printed[0]), contextlib.redirect_stderr(printed[1]):
                runpy.run_module(module, run_name="__main__")
        except SystemExit as end:
            status = int(end.code or 0)
    texts = [stream.buffer.getvalue().decode() for stream in printed if stream.flush() is None]
    return subprocess.CompletedProcess(arguments, status, *texts)


def last_of_each(module: str, arguments: Sequence[str]) -> list[str]:
    """Return a training's arguments without those that a later one of the same key replaces.

    Tests add keys to `SMALL`; a user may type none twice.
    """
    key_of = [word.lstrip("+").partition("=")[0] for word in arguments]
    if module != "zoo":
        return [*arguments]
    last = [key == "parts" or key not in key_of[at + 1 :] for at, key in enumerate(key_of)]
    return list(itertools.compress(arguments, last))


def run_words(cwd: Path, *words: str, **variables: str) -> subprocess.CompletedProcess:
    """Return the output and exit status of a program in a process and an environment of its own."""
    env = environment() | variables
    return subprocess.run(words, cwd=cwd, env=env, timeout=240, **CAPTURED)


def train_in_fork(module: str, *arguments: str, env: dict[str, str], cwd: Path) -> int:
    """Stand in for the `run_module` of `drivezoo rerun`, which takes seconds to import."""
    return run(cwd, *arguments, module=module, threads=env["OMP_NUM_THREADS"]).returncode


def start(cwd: Path, module: str, *arguments: str) -> subprocess.Popen | ForkedProcess:
    """Start `python -m MODULE ARGUMENTS`, whose output and errors are its `stdout`."""
    if sys.platform == "linux":
        return ForkedProcess(forked_commands(ROOT), [module, *arguments], cwd, environment())
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    return subprocess.Popen(command(module, *arguments), cwd=cwd, env=environment(), **streams)


@functools.cache
def forked_commands(code: Path) -> ForkedCommands:
    """Return the process that forks commands for all tests of this process."""
    return ForkedCommands(environment(code), code)


def succeed(result: subprocess.CompletedProcess) -> str:
    """Return what a command printed; fail on another exit status than 0."""
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


def only_line(result: subprocess.CompletedProcess, *statuses: int) -> str:
    """Return the one error line of a command; fail on a traceback or another status (1 or 2)."""
    assert result.returncode in (statuses or (1, 2)), result.stdout + result.stderr
    lines = result.stderr.strip().splitlines()
    assert len(lines) == 1, result.stderr
    return lines[0]

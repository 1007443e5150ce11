"""Errors of the user or the machine: one line, and no traceback."""

import io
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.hostile.conftest import Refusal
from tests.recordings import write_recording
from tests.zoo.command_runs import ROOT, command, environment, only_line, run_here, run_words
from tests.zoo.written_checkpoints import write_constant
from zoo.base.errors import InputError
from zoo.base.run_command import run_command
from zoo.simulator.track_file import read_track

# A library that commands import first: Debian's Python has `_socket` built in.
FIRST = "_socket|_queue"


Fail = Callable[[list[str]], object]


def raising(error: Exception) -> Fail:
    """Return a command that raises an error."""

    def fail(_: list[str]) -> None:
        raise error

    return fail


@pytest.mark.parametrize(
    ("fail", "words"),
    [
        (raising(MemoryError("Unable to allocate 52.0 GiB")), "memory"),
        (raising(RuntimeError("[enforce fail] Allocator: can't allocate memory: 9")), "memory"),
        (raising(RecursionError("maximum recursion depth exceeded")), "nested"),
        (raising(OSError(28, "No space left on device", "/disk/x.json")), "/disk/x.json: "),
        (lambda _: Path("~no.such.user/x").expanduser(), "a path begins with ~"),
        (lambda _: socket.getaddrinfo("a..b", 80), "a host's name"),
        (lambda _: socket.getaddrinfo("a" * 70, 80), "a host's name"),
    ],
)
def test_an_error_of_python_is_one_line(fail: Fail, words: str, refusal: Refusal) -> None:
    assert words in refusal("zoo", fail, [])


def test_a_bug_keeps_its_traceback_and_asks_for_a_report(capsys: pytest.CaptureFixture) -> None:
    assert run_command("zoo.commands.film", raising(ZeroDivisionError("of ours")), []) == 1
    lines = capsys.readouterr().err.strip().splitlines()
    assert lines[0].startswith("Traceback")
    assert "ZeroDivisionError: of ours" in lines[-2]
    assert lines[-1].startswith("zoo.commands.film: ")
    assert "report" in lines[-1]


def test_a_character_that_a_stream_lacks_is_replaced(monkeypatch: pytest.MonkeyPatch) -> None:
    printed = io.BytesIO()
    monkeypatch.setattr("sys.stdout", io.TextIOWrapper(printed, "ascii"))
    assert run_command("zoo", lambda _: print("12 m → läuft", flush=True), []) == 0
    assert printed.getvalue() == b"12 m ? l?uft\n"


def test_ctrl_c_in_a_finalizer_is_delivered_again() -> None:
    code = """
import time
from zoo.base.run_command import raise_interrupts
class Interrupted:
    def __del__(self):
        raise KeyboardInterrupt
raise_interrupts()
try:
    Interrupted()
    time.sleep(120)
except KeyboardInterrupt:
    print("stopped")
"""
    result = run_words(ROOT, sys.executable, "-c", code)
    assert (result.stdout, result.stderr) == ("stopped\n", "")


@pytest.mark.parametrize("after_s", [0, pytest.param(0.2, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    "arguments",
    [
        ("check", "nowhere"),
        ("simulator", "record", "out=laps"),
        ("doctor",),
        ("evaluate", "resume=nowhere"),
        ("train", "resume=nowhere"),
    ],
)
def test_ctrl_c_at_once_ends_a_command_with_one_line(
    arguments: tuple[str, ...], after_s: float, tmp_path: Path
) -> None:
    words = [sys.executable, "-c", "from zoo.base.console_script import main; main()", *arguments]
    streams = dict.fromkeys(("stdin", "stdout"), subprocess.DEVNULL) | {"stderr": subprocess.PIPE}
    process = subprocess.Popen(words, cwd=tmp_path, env=environment(), text=True, **streams)
    first = "_multiarray" if arguments[0] in ("check", "simulator") else FIRST
    maps = Path(f"/proc/{process.pid}/maps")
    until = time.monotonic() + 20
    # Until it imports the first of its libraries, or has ended.
    while process.poll() is None and time.monotonic() < until:
        if re.search(first, maps.read_text()):
            break
        time.sleep(0.002)
    time.sleep(after_s)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    if process.returncode == -signal.SIGABRT and "pybind11" in err:
        return  # it arrived within the initialisation of torch's C++, which knows no interrupt
    # The last two if the interrupt found the command at its end.
    assert process.returncode in (130, 1, -signal.SIGINT), err
    *before, last = err.strip().splitlines()
    assert "stopped" in last or process.returncode != 130
    assert len(before) <= 1  # the error that was just printed


@pytest.mark.parametrize("limit_mb", [500, pytest.param(600, marks=pytest.mark.slow)])
def test_too_little_memory_gets_one_line(limit_mb: int, tmp_path: Path) -> None:
    """The limit is half of what importing torch takes."""
    write_constant(tmp_path / "x.ckpt", 0.0)
    before = sorted(tmp_path.iterdir())
    limited = ("sh", "-c", f'ulimit -v {limit_mb}000; exec "$@"', "sh")
    words = command("zoo.commands.export", "x.ckpt", "out=x.onnx")
    line = only_line(run_words(tmp_path, *limited, *words, OPENBLAS_NUM_THREADS="1"))
    assert line.startswith("drivezoo export: ")
    assert "memory" in line
    assert sorted(tmp_path.iterdir()) == before


@pytest.fixture
def nobody(tmp_path: Path) -> Iterator[list[str]]:
    """Return the prefix that runs a command as a user without rights."""
    if os.geteuid() or not shutil.which("setpriv"):
        pytest.skip("only root can become another user")
    modes = {folder: folder.stat().st_mode for folder in (tmp_path, *tmp_path.parents[:2])}
    for folder, mode in modes.items():
        folder.chmod(mode | 0o055)
    yield ["setpriv", "--reuid=65534", "--regid=65534", "--clear-groups"]
    for folder, mode in modes.items():
        folder.chmod(mode)


@pytest.mark.parametrize("name", ["driving_log.csv", "."])
def test_an_unreadable_recording_is_named(name: str, nobody: list[str], tmp_path: Path) -> None:
    lake = write_recording(tmp_path / "lake", rows=20).folder
    (lake / name).chmod(0)
    try:
        words = [*nobody, *command("zoo.commands.check", str(lake))]
        result = run_words(tmp_path, *words, HOME=str(tmp_path))
    finally:
        (lake / name).chmod(0o755)
    unread = ("No module named", "can't open", "error while loading shared libraries")
    if any(words in result.stderr for words in unread):
        pytest.skip("the other user cannot read the program")
    line = only_line(result)
    assert str(lake) in line
    assert "ermission denied" in line


@pytest.mark.parametrize("name", ["a\0b.yaml", f"{'../' * 43_000}own.yaml"])
def test_a_track_with_an_impossible_name_is_refused(name: str) -> None:
    with pytest.raises(InputError, match="track"):
        read_track(name)


@pytest.mark.parametrize("value", [f"{{fog: {'9' * 5_000}}}", "[" * 5000, "[&a [1], *a]"])
def test_the_simulator_refuses_such_an_option(value: str, tmp_path: Path) -> None:
    arguments = ("record", "out=lake", f"weather={value}")
    only_line(run_here(tmp_path, *arguments, module="zoo.commands.simulator"))

"""Drives in several processes: their number, their results, and how they end."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tests.zoo.command_runs import ROOT, environment, run_words
from zoo.base import child_process, machine, process_pool
from zoo.base.errors import InputError, StoppedError, UsageError
from zoo.base.process_pool import Pool, opened_pool, run_jobs


@pytest.fixture(scope="module")
def pools() -> Iterator[dict[int, Pool]]:
    """Yield a pool of this process and one of two, which tests share: a new one takes seconds."""
    with opened_pool(1, most=3) as single, opened_pool(2, most=3) as two:
        yield {1: single, 2: two}


def run_all(function: Callable, jobs: list[tuple], workers: int, **more: Any) -> Iterator[tuple]:
    with opened_pool(workers, most=len(jobs)) as pool:
        yield from run_jobs(pool, function, jobs, **more)


def half(number: int, report: Callable[[float], None]) -> tuple[float, int]:
    """Return at once, in place of a drive."""
    return number / 2, os.getpid()


def test_what_cannot_be_sent_to_a_process_is_one_line_with_the_remedy() -> None:
    pools = opened_pool(2, most=2)
    with pools as pool, pytest.raises(UsageError, match=r"^workers=2: .*lambda.*a module that"):
        list(run_jobs(pool, half, [(lambda: 1,), (2,)]))


def end(number: int, report: Callable[[float], None]) -> None:
    """Kill this process, as the system does when memory runs out."""
    os.kill(os.getpid(), signal.SIGKILL)


def refuse(number: int, report: Callable[[float], None]) -> None:
    raise InputError(f"drive {number} cannot be")


def stop_half_way(go_on: Path, report: Callable[[float], None]) -> None:
    """Report half of the drive, then wait for a file."""
    report(0.5)
    wait_until(go_on.exists)


def never_end(begun: Path, report: Callable[[float], None]) -> None:
    """Create a file, then report and compute for minutes."""
    begun.touch()
    end_s = time.monotonic() + 300
    while time.monotonic() < end_s:
        report(0.5)


def stop(number: int, report: Callable[[float], None]) -> None:
    raise SystemExit(number)


@pytest.mark.parametrize("workers", [1, 2])
def test_progress_moves_in_a_drive(workers: int, pools: dict[int, Pool], tmp_path: Path) -> None:
    """The drives end only after a half finished one was shown as such."""
    go_on = tmp_path / "go on"
    shown = []

    def show(share: float) -> None:
        shown.append(share)
        if share == (0.25 if workers == 1 else 0.5):
            go_on.touch()

    done = dict(run_jobs(pools[workers], stop_half_way, [(go_on,), (go_on,)], show))
    assert done == {0: None, 1: None}
    assert go_on.exists(), f"only {shown} was shown"
    assert shown == sorted(shown)
    assert shown[-1] == 1


def test_progress_counts_the_work_of_each_job() -> None:
    shown: list[float] = []
    jobs = [(1,), (2,), (3,)]
    list(run_all(half, jobs, workers=1, show=shown.append, sizes=[60, 30, 10]))
    assert shown == pytest.approx([0.6, 0.9, 1.0])


def test_results_come_with_the_number_of_their_job(pools: dict[int, Pool]) -> None:
    results = dict(run_jobs(pools[2], half, [(4,), (6,), (8,)]))
    assert {number: value for number, (value, _) in results.items()} == {0: 2.0, 1: 3.0, 2: 4.0}
    assert os.getpid() not in {process for _, process in results.values()}


@pytest.mark.parametrize(("workers", "daemon"), [(1, False), (2, True)])
def test_one_worker_and_a_daemon_is_this_process(workers, daemon, monkeypatch) -> None:
    monkeypatch.setattr(process_pool.multiprocessing.current_process(), "daemon", daemon)
    assert list(run_all(half, [], workers)) == []
    results = dict(run_all(half, [(4,), (6,)], workers))
    assert results == {0: (2.0, os.getpid()), 1: (3.0, os.getpid())}


def test_a_pool_that_closes_ends_no_process_of_another_thread(tmp_path: Path) -> None:
    closed = tmp_path / "closed"

    def results(function: Callable, argument: object) -> int:
        values = dict(run_all(function, [(argument,), (argument,)], workers=2))
        closed.touch()
        return len(values)

    with ThreadPoolExecutor(2) as threads:
        assert list(threads.map(results, [half, stop_half_way], [1, closed])) == [2, 2]


def test_no_number_of_workers_is_one_for_each_core(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(process_pool, "usable_cores", lambda: 3)
    for most, processes in ((8, 3), (2, 2)):
        with opened_pool(0, most) as pool:
            assert pool.processes == processes


def test_a_process_that_is_killed_is_told_with_what_to_try() -> None:
    with pytest.raises(InputError, match=r"killed.* workers=1"):
        dict(run_all(end, [(1,), (2,)], workers=2))


@pytest.mark.parametrize("workers", [1, 2])
def test_a_drive_that_exits_ends_no_process_silently(workers: int, pools: dict[int, Pool]) -> None:
    with pytest.raises(SystemExit, match="3"):
        dict(run_jobs(pools[workers], stop, [(3,)]))


def test_what_a_drive_raises_is_raised_with_its_place(pools: dict[int, Pool]) -> None:
    with pytest.raises(InputError, match=r"drive \d cannot be") as refused:
        dict(run_jobs(pools[2], refuse, [(1,)]))
    assert "in refuse" in str(refused.value.__cause__)


PARENT = """
import sys
from pathlib import Path
from tests.zoo.base.test_process_pool import never_end, run_all
try:
    list(run_all(never_end, [(Path(one),) for one in sys.argv[1:]], workers=2))
except KeyboardInterrupt:
    sys.exit(130)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="sends POSIX signals")
@pytest.mark.parametrize(
    ("send", "number", "status"),
    [(os.killpg, signal.SIGINT, 130), (os.kill, signal.SIGKILL, -signal.SIGKILL)],
)
def test_all_end_with_the_parent(send: Callable, number: int, status: int, tmp_path: Path) -> None:
    """Signal the parent, or as a terminal does all processes, in the middle of two drives."""
    begun = [tmp_path / "1", tmp_path / "2"]
    words = [sys.executable, "-c", PARENT, *map(str, begun)]
    apart = {"stderr": subprocess.PIPE, "start_new_session": True}
    parent = subprocess.Popen(words, cwd=ROOT, env=environment(), **apart)
    try:
        wait_until(lambda: all(path.exists() for path in begun))
        send(parent.pid, number)
        # The pipe of errors ends when the last process has ended.
        _, errors = parent.communicate(timeout=60)
    finally:
        with suppress(ProcessLookupError):  # all have ended
            os.killpg(parent.pid, signal.SIGKILL)
    assert parent.returncode == status
    assert errors == b""


def wait_until(true: Callable[[], bool]) -> None:
    end_s = time.monotonic() + 60
    while not true():
        assert time.monotonic() < end_s
        time.sleep(0.02)


CHILD = "import zoo, time; print('begun', flush=True); time.sleep(300)"
STARTER = f"""
import subprocess, sys
from zoo.base.child_process import child_environment
subprocess.run([sys.executable, "-c", {CHILD!r}], env=child_environment())
"""


@pytest.mark.skipif(sys.platform == "win32", reason="sends POSIX signals")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_a_command_ends_with_the_command_that_started_it(number: int) -> None:
    parent = subprocess.Popen(
        [sys.executable, "-c", STARTER], cwd=ROOT, env=environment(), stdout=subprocess.PIPE
    )
    assert parent.stdout.readline() == b"begun\n"
    parent.send_signal(number)
    # The pipe ends when the child has ended, too.
    assert parent.communicate(timeout=60)[0] == b""
    assert parent.returncode == -number


SAVE = "import os, time; os.kill(os.getppid(), 2); time.sleep(0.8); open('saved', 'w')"


@pytest.mark.skipif(sys.platform == "win32", reason="sends POSIX signals")
def test_ctrl_c_leaves_a_child_time_to_save(monkeypatch, tmp_path: Path) -> None:
    monkeypatch.setattr(child_process, "module_command", lambda _: [sys.executable, "-c", SAVE])
    with pytest.raises(StoppedError):
        child_process.run_module("zoo", env={}, cwd=tmp_path)
    assert (tmp_path / "saved").exists()


def test_a_process_that_another_one_started_is_left_alone() -> None:
    """A variable that was inherited over a further process ends nothing."""
    quiet = "import zoo, time; time.sleep(0.9)"  # it looks after its parent every half second
    result = run_words(ROOT, sys.executable, "-c", quiet, DRIVEZOO_PARENT="1")
    assert result.returncode == 0


def test_no_launcher_of_windows_stands_between_parent_and_child(monkeypatch) -> None:
    python = SimpleNamespace(platform="win32", executable="env/python", _base_executable="python")
    monkeypatch.setattr(child_process, "sys", python)
    assert child_process.module_command("zoo")[0] == "python"
    assert child_process.child_environment()["__PYVENV_LAUNCHER__"] == "env/python"


def test_a_child_prints_utf_8_into_a_pipe(monkeypatch) -> None:
    monkeypatch.setenv("PYTHONIOENCODING", "cp1252")  # of a terminal on Windows
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    child = child_process.start_module("zoo.base.console_script", "check", "J\xf6rg", **streams)
    assert "J\xf6rg: " in child.communicate()[0].decode()


def test_a_child_ends_where_windows_has_no_terminal_to_stop_it(monkeypatch) -> None:
    monkeypatch.setattr("signal.CTRL_BREAK_EVENT", 10_000, raising=False)  # `os.kill` refuses it
    process = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    child_process.end_module(process, grace_s=0)
    assert process.returncode


@pytest.mark.parametrize(
    ("quota", "cores"), [(float("inf"), 4), (16.0, 4), (2.5, 3), (2.0, 2), (0.3, 1)]
)
def test_a_container_that_gives_less_time_counts(monkeypatch, quota, cores):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1, 2, 3}, raising=False)
    monkeypatch.setattr(machine, "_container_cores", lambda: quota)
    assert machine.usable_cores() == cores

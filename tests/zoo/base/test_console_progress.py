"""Progress on a terminal, what `-q` and `-v` change, and garbage collection during slow imports."""

import gc
import io
import os
import pty
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
from rich.console import Console

from tests.spared_work import count_frozen
from tests.zoo.command_runs import command, environment
from zoo.base import console_progress
from zoo.base.console_progress import loading, progress_bar, working
from zoo.base.errors import InputError
from zoo.base.run_command import run_command
from zoo.base.terminal import VARIABLE, is_quiet, is_verbose, print_written


@pytest.fixture
def terminal() -> Console:
    return Console(file=io.StringIO(), width=100, force_terminal=True)


def test_a_terminal_shows_a_bar_that_leaves_nothing(terminal: Console) -> None:
    with progress_bar("2 drives of 1 lap [/red]", terminal) as show:
        show(0.25)
        time.sleep(0.3)
        drawn = terminal.file.getvalue()
    assert "2 drives of 1 lap [/red]" in drawn
    assert "25%" in drawn
    assert terminal.file.getvalue().endswith("\x1b[2K"), "the line is erased"


def test_a_log_gets_a_line_at_intervals(console: Console, monkeypatch: pytest.MonkeyPatch) -> None:
    with progress_bar("driving", console) as show:
        for share in (0.1, 0.2):
            show(share)
    assert not console.file.getvalue(), "short work needs no line"
    monkeypatch.setattr(console_progress, "LINE_EVERY_S", 0.0)
    with progress_bar("driving [/red]", console) as show:
        show(0.0)
        show(0.5)
    first, second = console.file.getvalue().splitlines()
    assert first.startswith("driving [/red]: 0%")
    assert second.startswith("driving [/red]: 50%")
    assert "left" in second


def test_time_left_begins_at_first_work(console: Console, monkeypatch: pytest.MonkeyPatch) -> None:
    times = iter([0.0, 20.0, 30.0])  # it begins, its processes have started, half is done
    monkeypatch.setattr(console_progress.time, "monotonic", lambda: next(times))
    with progress_bar("driving", console) as show:
        show(0.0)
        show(0.5)
    assert "driving: 50% after 30 s, 10 s left" in console.file.getvalue()


def test_a_notebook_gets_one_line_that_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(console_progress, "NOTEBOOK_EVERY_S", 0.0)
    notebook = Console(file=io.StringIO(), width=100, force_jupyter=True)
    with progress_bar("driving [/red]", notebook) as show:
        show(0.5)
        show(1.0)
    printed = notebook.file.getvalue()
    assert "\n" not in printed
    begin, first, second, erased, end = printed.split("\r")
    assert first.startswith("driving [/red]: 50%")
    assert second.startswith("driving [/red]: 100%")
    assert len(second) >= len(first), "nothing of the first text is left"
    assert erased.isspace()
    assert [begin, end] == ["", ""]


def test_work_without_a_share_is_shown_only_on_a_terminal(
    console: Console, terminal: Console, capsys: pytest.CaptureFixture
) -> None:
    for shown in (console, terminal):
        with working("writing the report", shown):
            pass
    with loading():
        pass
    assert not console.file.getvalue()
    assert "writing the report" in terminal.file.getvalue()
    assert capsys.readouterr() == ("", "")


def on_a_terminal(cwd: Path, *words: str) -> str:
    """Return the output of a command on a terminal."""
    ours, theirs = pty.openpty()
    env = environment() | {"TERM": "xterm"}
    process = subprocess.Popen(words, cwd=cwd, env=env, stdout=theirs, stderr=theirs)
    os.close(theirs)
    printed = b""
    try:
        with suppress(OSError):  # raised by Linux when the other side is closed
            while chunk := os.read(ours, 65_536):
                printed += chunk
    finally:
        process.kill()
        process.wait()
        os.close(ours)
    return printed.decode(errors="replace")


def test_evaluate_shows_its_work_from_loading_on(run_folder: Path, tmp_path: Path) -> None:
    options = ("laps=0.03", "quality=simple", f"out={tmp_path / 'out'}")
    printed = on_a_terminal(tmp_path, *command("zoo.commands.evaluate", str(run_folder), *options))
    loads, drives, table = (
        printed.find(text) for text in ("loading PyTorch", "1 drive of 0.03 laps", "autonomy")
    )
    assert 0 <= loads < drives < table


@pytest.mark.slow
def test_the_list_of_networks_shows_that_it_builds_them(tmp_path: Path) -> None:
    printed = on_a_terminal(tmp_path, *command("zoo.commands.list", "models"))
    assert 0 <= printed.find("building the networks") < printed.find("multiply-adds")


def test_a_typo_and_help_are_not_preceded_by_anything(tmp_path: Path) -> None:
    assert "loading" not in on_a_terminal(tmp_path, *command("zoo.commands.evaluate", "none.ckpt"))
    assert "loading" not in on_a_terminal(tmp_path, *command("zoo", "--help"))


# In its own process, because the tests' process has frozen its objects.
SOURCE = """
import gc
from zoo.base.console_progress import loading
runs = []
with loading():
    gc.callbacks.append(lambda phase, info: runs.append(info["generation"]))
    created = [[] for _ in range(100_000)]
    print(len(runs))
print(len(gc.get_objects(generation=0)) < 10_000, len(gc.get_objects(generation=2)) > 100_000)
print(gc.isenabled(), gc.get_freeze_count())
"""


def test_no_collection_runs_while_loading_and_the_next_one_skips_what_was_loaded():
    ran = subprocess.run([sys.executable, "-c", SOURCE], capture_output=True, text=True, check=True)
    assert ran.stdout.split() == ["0", "True", "True", "True", "0"]


def test_collection_resumes_after_an_error():
    def import_nothing() -> None:
        assert not gc.isenabled()
        raise ImportError("torch")

    with pytest.raises(ImportError), loading():
        import_nothing()
    assert gc.isenabled()


def test_what_the_process_has_set_is_kept():
    frozen = count_frozen()
    assert frozen  # see tests/conftest.py
    with loading():
        pass
    assert count_frozen() == frozen
    gc.disable()
    try:
        with loading():
            pass
        assert not gc.isenabled()
    finally:
        gc.enable()


@pytest.fixture(autouse=True)
def _own_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "")


def work(arguments: list[str]) -> None:
    """Fail with an argument, else print progress and what was written."""
    if arguments:
        raise InputError(f"{arguments[0]}: is wrong")
    console = Console()
    with progress_bar("working", console) as show:
        show(0.5)
    print_written([Path("a.csv")], ["report"], console)


def test_quiet_prints_less(capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("zoo.base.console_progress.LINE_EVERY_S", 0)
    assert run_command("work", work, []) == 0
    usual = capsys.readouterr().out
    assert "working: 50%" in usual
    assert "next: drivezoo report" in usual
    assert run_command("work", work, ["-q"]) == 0
    assert capsys.readouterr().out == "wrote: a.csv\n"
    assert is_quiet()
    assert not is_verbose()


def test_verbose_adds_the_traceback_to_the_line_of_an_error(capsys: pytest.CaptureFixture) -> None:
    assert run_command("work", work, ["x"]) == 1
    assert capsys.readouterr().err == "work: x: is wrong\n"
    assert run_command("work", work, ["-v", "x"]) == 1
    lines = capsys.readouterr().err.splitlines()
    assert lines[0].startswith("Traceback")
    assert lines[-1] == "work: x: is wrong"

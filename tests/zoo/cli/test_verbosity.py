"""`-q` prints less, `-v` more, in every command."""

from pathlib import Path

import pytest
from rich.console import Console

from zoo.base.errors import InputError
from zoo.base.run_command import run_command
from zoo.base.terminal import VARIABLE, is_quiet, is_verbose, print_written
from zoo.cli.console_progress import progress_bar


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


def test_quiet_leaves_progress_and_hints_out(
    capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("zoo.cli.console_progress.LINE_EVERY_S", 0)
    assert run_command("work", work, []) == 0
    usual = capsys.readouterr().out
    assert "working: 50%" in usual
    assert "next: drivezoo report" in usual
    assert run_command("work", work, ["-q"]) == 0
    assert capsys.readouterr().out == "wrote: a.csv\n"
    assert is_quiet()
    assert not is_verbose()


def test_verbose_adds_the_traceback_to_the_line_of_an_error(
    capsys: pytest.CaptureFixture,
) -> None:
    assert run_command("work", work, ["x"]) == 1
    assert capsys.readouterr().err == "work: x: is wrong\n"
    assert run_command("work", work, ["-v", "x"]) == 1
    lines = capsys.readouterr().err.splitlines()
    assert lines[0].startswith("Traceback")
    assert lines[-1] == "work: x: is wrong"

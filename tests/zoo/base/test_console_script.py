"""The console script `drivezoo`, and the exit codes of commands."""

import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

from tests.zoo.command_runs import run, run_here, run_words
from zoo.base.console_script import commands
from zoo.base.run_command import WRONG_USE

CALL = "import sys; from zoo.base.console_script import main; sys.exit(main())"


def drivezoo(cwd: Path, *arguments: str) -> subprocess.CompletedProcess:
    """Return the output of `main`, called as the installed script calls it."""
    return run_words(cwd, sys.executable, "-c", CALL, *arguments)


# An exit handler that is registered before a command's runs after them.
LAST = "import atexit, gc; atexit.register(lambda: print('frozen', gc.get_freeze_count() > 1000));"


def test_every_command_has_a_name_and_a_purpose(tmp_path: Path) -> None:
    lines = drivezoo(tmp_path, "--help").stdout.splitlines()
    for name in ("train", "drive", "evaluate", "leaderboard", "film", "check", "simulator"):
        (line,) = [text for text in lines if text.split()[:1] == [name]]
        assert len(line.split()) > 3
    assert "losses" not in commands()
    assert "cli" not in commands()


def test_a_command_is_that_of_python_m(tmp_path: Path) -> None:
    result = drivezoo(tmp_path, "report", "no run=[1]")
    assert result.returncode == 1
    assert "no run=[1]" in result.stderr
    assert drivezoo(tmp_path, "leaderboard", "--help").stdout.startswith("usage: ")
    assert "zoo_lake" in drivezoo(tmp_path, "tracks").stdout, "drivezoo list tracks"


def test_older_names_are_typed_below_another_command(tmp_path: Path) -> None:
    assert "no: " in drivezoo(tmp_path, "train", "rerun=no", "out=again").stderr
    (tmp_path / "sweep").mkdir()
    (tmp_path / "sweep" / "sweep.json").write_text("{}")
    stopped = drivezoo(tmp_path, "train", "resume=sweep")
    assert stopped.stderr.startswith("drivezoo sweep: ")
    assert len(stopped.stderr.splitlines()) == 1


@pytest.mark.parametrize("flags", [["-q"], ["-v"], ["--quiet", "-v"]])
def test_how_much_is_printed_may_stand_before_the_command(flags: list[str], tmp_path: Path) -> None:
    before = drivezoo(tmp_path, *flags, "list")
    assert (before.returncode, before.stderr) == (0, "")
    assert ("next: " in before.stdout) == (flags != ["-q"])
    assert drivezoo(tmp_path, "list", *flags).stdout == before.stdout


def test_a_typo_gets_one_line_and_the_status_of_wrong_use(tmp_path: Path) -> None:
    result = drivezoo(tmp_path, "evalute")
    assert result.returncode == WRONG_USE
    (line,) = result.stderr.splitlines()
    assert "did you mean evaluate?" in line


def test_keys_without_a_command_name_the_training(tmp_path: Path) -> None:
    result = drivezoo(tmp_path, "experiment=first_try", "data.root=my laps")
    assert result.returncode == WRONG_USE
    wanted = "did you mean drivezoo train experiment=first_try 'data.root=my laps'?"
    assert wanted in result.stderr


def test_the_version_is_that_of_the_package(tmp_path: Path) -> None:
    line = drivezoo(tmp_path, "--version").stdout
    assert line.startswith(f"drivezoo {version('drivezoo')} (Python 3.")
    for module in ("zoo", "zoo.commands.evaluate", "zoo.commands.leaderboard"):
        assert run(tmp_path, "--version", module=module).stdout == line


@pytest.mark.parametrize(
    ("status", "command", "remedy"),
    [
        (WRONG_USE, "zoo model=lenett", "did you mean lenet"),
        (WRONG_USE, "zoo.commands.drive drive.port=1", "drivezoo drive CKPT"),
        (WRONG_USE, "zoo.commands.simulator recrd", "did you mean record"),
        (1, "zoo data.root=nowhere", "nowhere"),
        (1, "zoo.commands.evaluate no.ckpt", "no.ckpt"),
        (1, "zoo.commands.leaderboard nowhere", "nowhere"),
        (WRONG_USE, "zoo.commands.simulator record out=x track=nowhere", "nowhere"),
    ],
)
def test_wrong_use_is_no_failure(status: int, command: str, remedy: str, tmp_path: Path) -> None:
    module, *arguments = command.split()
    result = run_here(tmp_path, *arguments, module=module)
    assert result.returncode == status, result.stderr
    assert remedy in result.stderr


def test_a_command_ends_without_a_look_at_all_objects(tmp_path: Path) -> None:
    end = run_words(tmp_path, sys.executable, "-c", LAST + CALL, "list")
    assert end.stdout.splitlines()[-1] == "frozen True"

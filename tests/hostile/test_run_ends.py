"""The end of a run, and standard output that fails: no figures or checkpoints are lost."""

import errno
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from tests.recordings import Written
from tests.slow_members import slow
from tests.zoo.command_runs import command, environment, only_line, run_here, run_words, succeed
from tests.zoo.trainings import SMALL
from zoo.base.run_command import ForgivingOutput
from zoo.training import conclusion

FULL = Path("/dev/full")
posix = pytest.mark.skipif(os.name != "posix", reason="names of any bytes, /dev/full")


def arguments(root: str) -> list[str]:
    return [*SMALL, f"data.root={root}", "trainer.max_epochs=1", "hydra.run.dir=run"]


def check_whole(run: Path) -> None:
    assert json.loads((run / "metrics.json").read_text())["epochs"] == 1
    assert json.loads((run / "status.json").read_text())["status"] == "finished"
    for name in ("best.ckpt", "last.ckpt"):
        assert (run / "checkpoints" / name).is_file()
    assert (run / "report" / "index.html").is_file()


@posix
@pytest.mark.slow
def test_a_recording_whose_folder_is_not_utf_8(recorded: Written, tmp_path: Path) -> None:
    root = tmp_path / os.fsdecode(b"laps\xff\xe4")
    shutil.copytree(recorded.folder, root)
    result = run_words(tmp_path, *command("zoo", *arguments(str(root))))
    assert (result.returncode, result.stderr) == (0, "")
    check_whole(tmp_path / "run")
    result = run_words(tmp_path, *command("zoo", "resume=run", "trainer.max_epochs=2"))
    assert (result.returncode, result.stderr) == (0, "")


@posix
@pytest.mark.slow
@pytest.mark.parametrize("buffered", ["", "1"])
def test_a_standard_output_that_is_full(buffered: str, recorded: Written, tmp_path: Path) -> None:
    line = ["sh", "-c", f'"$@" >{FULL}', "sh", *command("zoo", *arguments(str(recorded.folder)))]
    result = run_words(tmp_path, *line, PYTHONUNBUFFERED=buffered)
    assert "No space left on device" in only_line(result, 1)
    check_whole(tmp_path / "run")


def test_a_report_that_fails_gets_one_line(
    recorded: Written, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(folder: Path) -> Path:
        raise UnicodeEncodeError("utf-8", "\udcff", 0, 1, "no character")

    monkeypatch.setattr(conclusion, "write_report", fail)
    printed = succeed(run_here(tmp_path, *arguments(str(recorded.folder))))
    (line,) = [text for text in printed.splitlines() if "report not written" in text]
    assert "no character" in line
    assert json.loads((tmp_path / "run" / "metrics.json").read_text())["epochs"] == 1


@posix
def test_a_recording_that_is_removed_while_it_trains(
    recorded: Written, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = Path(shutil.copytree(recorded.folder, tmp_path / "laps"))
    before = conclusion.open_loop_metrics

    def remove(*given: object) -> dict:
        shutil.rmtree(root, ignore_errors=True)
        return before(*given)

    monkeypatch.setattr(conclusion, "open_loop_metrics", remove)
    result = run_here(tmp_path, *arguments(str(root)))
    assert (result.returncode, result.stderr) == (0, "")
    check_whole(tmp_path / "run")


MAIN = "from zoo.base.console_script import main; raise SystemExit(main())"
SCRIPT = [sys.executable, "-c", MAIN]
COMMANDS = ["--help", "check", "list tracks", *slow("check --help")]


def printing(name: str, recorded: Written, cwd: Path, shell: str, close: bool) -> tuple[int, str]:
    """Return the exit status of a command and its errors, for a redirection of its output."""
    words = {"check": ["check", str(recorded.folder)]}.get(name, name.split())
    line = ["sh", "-c", f'exec "$@" {shell}', "sh", *SCRIPT, *words]
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(line, cwd=cwd, env=environment(), **streams) as process:
        if close:
            process.stdout.close()
        _, errors = process.communicate()
    return process.returncode, errors


@pytest.mark.skipif(not FULL.exists(), reason="the system has no /dev/full")
@pytest.mark.parametrize("name", COMMANDS)
def test_a_full_disk_is_one_line(name: str, recorded: Written, tmp_path: Path) -> None:
    status, errors = printing(name, recorded, tmp_path, f">{FULL}", close=False)
    assert status == 1
    (line,) = errors.splitlines()
    assert "standard output: " in line


@posix
@pytest.mark.slow
def test_a_training_whose_reader_ends_early_is_whole(recorded: Written, tmp_path: Path) -> None:
    words = [*SCRIPT, "train", *arguments(str(recorded.folder))]
    result = run_words(tmp_path, "sh", "-c", '"$@" | head -n 1', "sh", *words)
    assert (len(result.stdout.splitlines()), result.stderr) == (1, "")
    check_whole(tmp_path / "run")


@posix
@pytest.mark.parametrize(("shell", "close"), [(">&-", False), ("", True)], ids=["closed", "pipe"])
@pytest.mark.parametrize("name", COMMANDS)
def test_an_output_that_is_closed_or_ends_early_is_no_error(
    name: str, shell: str, close: bool, recorded: Written, tmp_path: Path
) -> None:
    assert printing(name, recorded, tmp_path, shell, close) == (0, "")


def test_an_output_that_ends_early_is_no_error_on_windows(tmp_path: Path) -> None:
    """Writing to a broken pipe is EINVAL there."""

    def write(_: str) -> None:
        raise OSError(errno.EINVAL, "Invalid argument")

    with (tmp_path / "pipe").open("w") as file:
        output = ForgivingOutput(SimpleNamespace(write=write, fileno=file.fileno))
        output.write("a line")
    assert output.failure is None

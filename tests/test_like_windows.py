"""The commands without what Windows lacks; emulated, since no test of ours has run on Windows."""

import runpy
import subprocess
import sys
from pathlib import Path, PureWindowsPath
from types import SimpleNamespace
from unittest.mock import Mock

import pytest

from datamodules.recording import LOG_NAME
from tests.like_windows import like_windows
from tests.recordings import Written
from tests.zoo import command_runs as commands
from zoo.base.compose import compose_config
from zoo.base.terminal import command_line
from zoo.base.whole_file import write_whole
from zoo.checkpoints.checkpoint_files import CheckpointFiles

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="emulates Windows on Linux")
IMPORT_ALL = runpy.run_path(str(commands.ROOT / ".ci" / "matrix.py"))["IMPORT_ALL"]
CACHED = """
import sys
from pathlib import Path
from datamodules.view import View
from datamodules.view_store import load_views
paths = sorted(map(str, Path(sys.argv[1]).rglob("*.jpg")))
view = View((60, 25), "rgb", None)
kept = load_views(paths, view, None).views
assert (load_views(paths, view, Path("cache")).views == kept).all()
"""


class Windows:
    """A folder in which commands run without what Windows lacks."""

    def __init__(self, root: Path) -> None:
        self.place = root
        self.variables = like_windows(root / "site", commands.environment())

    def run(self, *words: str) -> str:
        """Return what `python WORDS` prints."""
        how = {"cwd": self.place, "env": self.variables, "timeout": 300}
        done = subprocess.run([sys.executable, *words], capture_output=True, check=False, **how)
        printed = (done.stdout + done.stderr).decode("cp1252")
        assert done.returncode == 0, printed
        return printed

    def command(self, module: str, words: str) -> str:
        """Return what `python -m MODULE WORDS` prints."""
        return self.run("-m", module, *words.split())


@pytest.fixture
def windows(tmp_path: Path) -> Windows:
    return Windows(tmp_path)


def test_every_module_can_be_imported(windows: Windows) -> None:
    assert int(windows.run("-c", IMPORT_ALL).split()[0]) > 300  # modules


def test_threads_write_the_cache_of_views(windows: Windows, recorded: Written) -> None:
    windows.run("-c", CACHED, str(recorded.folder))


def test_a_folder_with_an_open_file_keeps_its_name(windows: Windows) -> None:
    (windows.place / "lake").mkdir()
    with pytest.raises(AssertionError, match="PermissionError"):
        windows.run("-c", "import os; log = open('lake/log.csv', 'wb'); os.rename('lake', 'hill')")


def test_a_new_file_that_fails_is_closed_and_removed(windows: Windows) -> None:
    failing = "import pathlib, zoo.base.whole_file as file; file.write_new(pathlib.Path('a'), 0)"
    with pytest.raises(AssertionError, match="TypeError: a bytes-like object is required"):
        windows.run("-c", failing)
    assert not (windows.place / "a").exists()


def test_a_checkpoint_that_another_program_reads_stays(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("os.remove", Mock(side_effect=PermissionError))
    CheckpointFiles().remove_checkpoint(write_whole(tmp_path / "epoch=1.ckpt", "read"))
    assert (tmp_path / "epoch=1.ckpt").exists()


@pytest.mark.slow
def test_a_network_drives_over_the_socket(windows: Windows) -> None:
    printed = windows.command("zoo.commands.drive", "lenet sim=lake laps=0.01 port=0")
    assert "autonomy 100.0%" in printed


@pytest.mark.slow
def test_record_train_evaluate_and_drive(windows: Windows) -> None:
    windows.command("zoo.commands.simulator", "record out=lake laps=0.3 quality=simple jobs=2")
    write_as_on_windows(windows.place / "lake" / LOG_NAME)
    short = "trainer.max_epochs=1 score.laps=0.02 hydra.run.dir=run"
    windows.command("zoo", f"model=tiny data.root=lake data.workers=2 {short}")
    score = "run seeds=2 workers=2 laps=0.02 quality=simple out=score"
    windows.command("zoo.commands.evaluate", score)
    windows.command("zoo.commands.drive", "run sim=lake laps=0.02 port=0 record=driven")
    written = {path.name for path in windows.place.rglob("*")}
    assert {"best.ckpt", "metrics.json", "drive.csv"} <= written
    assert not [name for name in written if set(name) & set('<>:"|?*\\') or name[-1] in " ."]


def write_as_on_windows(log: Path) -> None:
    """Write a driving log with the paths and line ends of the simulator on Windows."""
    rows = [line.split(",") for line in log.read_text(encoding="utf-8").splitlines()]
    folder = PureWindowsPath("C:/Users/Ann Smith/Desktop/lake/IMG")
    for row in rows:
        row[:3] = [str(folder / Path(path).name) for path in row[:3]]
    log.write_text("".join(",".join(row) + "\r\n" for row in rows), encoding="utf-8", newline="")


@pytest.mark.parametrize("folder", ["C:\\Users\\Ann Smith\\lake", "..\\lake"])
def test_a_path_of_windows_reaches_the_config_as_it_was_typed(folder: str) -> None:
    assert compose_config([f"data.root={folder}"])["data"]["root"] == folder


def test_a_printed_command_has_the_only_quotes_of_cmd(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("zoo.base.terminal.os", SimpleNamespace(name="nt"))
    words = ["drivezoo", "film", "outputs\\run", "columns=a,b", "fps=15", "out=D:\\"]
    assert command_line(words) == r'drivezoo film "outputs\run" "columns=a,b" fps=15 "out=D:\\"'
    # A stranger's names: PowerShell and cmd.exe would run their parts within the quotes.
    names = ['a" & b', "$(b)", "`b", "%a:~-1% & b", "\u201d; b", "C$\\100%"]
    assert command_line(names) == r'"a? & b" "?(b)" "?b" "?a:~-1% & b" "?; b" "C$\100%"'

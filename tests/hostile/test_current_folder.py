"""`drivezoo COMMAND` in a folder of a stranger, whose files have the names of modules."""

import sys
from pathlib import Path

import pytest

from tests.zoo.command_runs import ROOT, run_words, succeed
from zoo.base.child_process import find_program, module_command
from zoo.runs.code_fingerprint import commit_of

FOLDERS = ("zoo", "datamodules", "drivezoo", "hydra_plugins/stranger")
FILES = (
    *("torch", "numpy", "yaml", "hydra", "lightning", "sitecustomize", "usercustomize"),
    *("runpy", "pickle", "multiprocessing", "socket", "json", "typing"),
)
# What pip writes to the folder of scripts.
SCRIPT = "import sys\nfrom zoo.base.console_script import main\nsys.exit(main())\n"
SPAWN = """
import multiprocessing, sys
sys.path[:] = filter(None, sys.path)
from zoo.base.module_start import clean_spawned_processes
clean_spawned_processes()
if __name__ == "__main__":
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        print(pool.map(abs, [-1]))
"""


@pytest.fixture
def stranger(tmp_path: Path) -> Path:
    """Return a folder with modules that leave a file `ran` when they are imported."""
    folder = tmp_path / "stranger"
    paths = [folder / f"{name}.py" for name in FILES]
    paths += [folder / name / "__init__.py" for name in FOLDERS]
    for path in paths:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"open({str(folder / 'ran')!r}, 'a').write(__file__ + '\\n')\n")
    return folder


def run(folder: Path, *words: str) -> str:
    """Return the output of a command in the stranger's folder, whose files must not run."""
    result = run_words(folder, *words)
    ran = folder / "ran"
    assert not ran.exists(), ran.read_text()
    return succeed(result)


def drivezoo(folder: Path, *arguments: str) -> str:
    script = folder.with_name("drivezoo")
    script.write_text(SCRIPT)
    return run(folder, sys.executable, str(script), *arguments)


def test_a_command_runs_none_of_its_files(stranger: Path) -> None:
    assert "leaderboard" in drivezoo(stranger, "--help")
    assert "lake" in drivezoo(stranger, "tracks")


def test_a_child_process_runs_none_of_its_files(stranger: Path) -> None:
    assert "lake" in run(stranger, *module_command("zoo.commands.list", "tracks"))


def test_no_program_of_the_folder_is_found(stranger: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Before Python 3.12, `which` looks there first on Windows."""
    (stranger / "git").touch(0o755)
    monkeypatch.chdir(stranger)
    monkeypatch.setenv("PATH", ".")
    assert find_program("git") is commit_of(ROOT) is None


def test_a_spawned_process_runs_none_of_its_files_without_safe_path(stranger: Path) -> None:
    """Python 3.10 knows no PYTHONSAFEPATH: this script sets none, either."""
    script = stranger.with_name("spawn.py")
    script.write_text(SPAWN)
    assert "[1]" in run(stranger, sys.executable, str(script))

"""Each folder of `zoo/extras` can be deleted with its tests: the core does not notice."""

import os
import shutil
import subprocess
import sys
from importlib.metadata import distribution
from pathlib import Path

import pytest

from zoo.base.console_script import ALIASES, extra_commands
from zoo.base.entry_points import is_extra

ROOT = Path(__file__).parents[1]
EXTRAS = sorted(path.name for path in (ROOT / "zoo" / "extras").iterdir() if path.is_dir())
EXTRAS = [name for name in EXTRAS if not name.startswith("_")]
DRIVEZOO = "import sys; from zoo.base.console_script import main; sys.exit(main())"
LEFT_OUT = shutil.ignore_patterns(".*", "outputs", "__pycache__", "_build", "dist")


def without(name: str, folder: Path) -> Path:
    """Return a copy of the checkout without an extra and its tests."""
    shutil.copytree(ROOT, folder, ignore=LEFT_OUT)
    shutil.rmtree(folder / "zoo" / "extras" / name)
    shutil.rmtree(folder / "tests" / "zoo" / "extras" / name, ignore_errors=True)
    return folder


def joined(name: str) -> set[str]:
    """Return the places of an extra that entry points name."""
    entries = filter(is_extra, distribution("drivezoo").entry_points)
    return {entry.value for entry in entries if entry.value.startswith(f"zoo.extras.{name}.")}


def run(folder: Path, *words: str) -> subprocess.CompletedProcess:
    given = os.environ | {"PYTHONPATH": str(folder)}
    return subprocess.run(
        [sys.executable, *words], cwd=folder, env=given, capture_output=True, text=True, check=False
    )


@pytest.mark.parametrize("name", EXTRAS)
def test_without_an_extra_the_other_commands_are_there(name: str, tmp_path: Path) -> None:
    copy = without(name, tmp_path / "copy")
    printed = run(copy, "-c", DRIVEZOO, "--help")
    assert printed.returncode == 0, printed.stderr
    shown = {line.split()[0] for line in printed.stdout.splitlines() if line.startswith("  ")}
    assert joined(name), "an extra that nothing joins"
    places = extra_commands()
    gone = {command for command, place in places.items() if place in joined(name)}
    assert gone.isdisjoint(shown)
    assert shown >= {"train", "evaluate", *places} - gone - {*ALIASES}
    for command in gone:
        typed = run(copy, "-c", DRIVEZOO, command)
        assert typed.returncode == 2
        assert "no such command" in typed.stderr


@pytest.mark.slow
@pytest.mark.parametrize("name", EXTRAS)
def test_without_an_extra_the_rest_passes(name: str, tmp_path: Path) -> None:
    copy = without(name, tmp_path / "copy")
    ignored = [f"--ignore=tests/{page}" for page in ("test_extras.py", "test_manual.py")]
    ignored += ["--ignore=tests/test_model_pages.py", "--ignore=tests/test_count_code.py"]
    result = run(copy, "-m", "pytest", "-q", "-n", "2", "-m", "not slow", *ignored, "tests")
    assert result.returncode == 0, result.stdout[-3000:]

"""A user's own `zoo`, `datamodules` or `simulator` beside a script: one line says which it is."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.zoo.command_runs import ROOT

SCRIPT = "import drivezoo\ndrivezoo.evaluate\nprint('works')\n"
STARTS = {
    "a script": ("script.py",),
    "a notebook": ("-c", SCRIPT),  # whose folder is the first on the path
    "python -m": ("-m", "zoo", "--help"),
    "a test of a part": ("-m", "pytest", "-q", "test_part.py"),
}


def start(folder: Path, how: str) -> subprocess.CompletedProcess:
    (folder / "script.py").write_text(SCRIPT)
    (folder / "test_part.py").write_text("import drivezoo\n\ndef test(): drivezoo.evaluate\n")
    given = os.environ | {"PYTHONPATH": str(ROOT)}
    given.pop("PYTHONSAFEPATH", None)
    return subprocess.run(
        [sys.executable, *STARTS[how]], cwd=folder, env=given, capture_output=True, text=True
    )


@pytest.mark.parametrize("how", STARTS)
@pytest.mark.parametrize("hidden", ["zoo/__init__.py", "zoo.py", "datamodules/__init__.py"])
def test_what_hides_a_package_is_named(hidden: str, how: str, tmp_path: Path) -> None:
    if how == "python -m" and hidden.startswith("zoo"):
        pytest.skip("starts the user's own")
    (tmp_path / hidden).parent.mkdir(exist_ok=True)
    (tmp_path / hidden).write_text("")
    result = start(tmp_path, how)
    assert result.returncode
    said = result.stdout + result.stderr
    assert "hides drivezoo's own package" in said
    assert str(tmp_path / hidden) in said
    assert "rename it" in said


@pytest.mark.parametrize("how", STARTS)
def test_what_hides_nothing_is_left_alone(how: str, tmp_path: Path) -> None:
    for beside in ("simulator.py", "simulator/__init__.py", "zoo/notes.txt"):
        (tmp_path / beside).parent.mkdir(exist_ok=True)
        (tmp_path / beside).write_text("")
    result = start(tmp_path, how)
    assert result.returncode == 0, result.stderr

"""Which libraries a command imports, and a user's own `zoo` or `datamodules` that hides ours."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.zoo.command_runs import CAPTURED, ROOT, environment
from zoo.base.console_script import commands

DRIVING = """
import zoo.checkpoints.checkpoint_policy, zoo.server.live_page, zoo.scoring.evaluation
import zoo.scoring.visual_backprop
"""


@pytest.mark.parametrize(
    ("code", "slow"),
    [
        ("import drivezoo", {"torch", "hydra", "matplotlib", "cv2"}),
        # They would make `drivezoo drive` and `drivezoo evaluate` start two seconds later.
        (DRIVING, {"albumentations", "lightning", "torchmetrics"}),
    ],
)
def test_only_what_needs_a_slow_library_imports_it(code: str, slow: set[str]) -> None:
    command = [sys.executable, "-c", f"{code}\nimport sys; print(*sys.modules)"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert not slow & {*done.stdout.split()}


WRONG = """
import contextlib, io, sys
from zoo.base.console_script import main
for typed in sys.argv[1:]:
    sys.argv = ["drivezoo", *typed.split()]
    with contextlib.redirect_stderr(io.StringIO()) as printed:
        try:
            main()
        except SystemExit as end:
            assert end.code, typed
    assert "nowhere" in printed.getvalue(), printed.getvalue()
    assert "torch" not in sys.modules, typed
"""
TYPOS = (
    *("grade nowhere", "report nowhere", "import nowhere.h5", "compare nowhere nowhere"),
    *("preview data.root=nowhere", "train data.root=nowhere"),
    *("benchmark lenet suite=nowhere", "evaluate lenet track=nowhere"),
    *("sweep resume=nowhere", "leaderboard nowhere", "rerun nowhere"),
)


def test_a_wrong_path_is_reported_before_torch_is_imported(tmp_path: Path) -> None:
    typed = [words for words in TYPOS if words.partition(" ")[0] in commands()]
    command = [sys.executable, "-c", WRONG, *typed]
    subprocess.run(command, cwd=tmp_path, env=environment(), check=True, timeout=60)
    status = next(tmp_path.glob("outputs/*/*/status.json"))
    assert json.loads(status.read_text())["status"] == "failed"


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
    return subprocess.run([sys.executable, *STARTS[how]], cwd=folder, env=given, **CAPTURED)


@pytest.mark.parametrize("how", STARTS)
@pytest.mark.parametrize("hidden", ["zoo/__init__.py", "zoo.py", "datamodules/__init__.py"])
def test_what_hides_a_package_is_named(hidden: str, how: str, tmp_path: Path) -> None:
    if how == "python -m" and hidden.startswith("zoo"):
        pytest.skip("starts the user's own")
    (tmp_path / hidden).parent.mkdir(exist_ok=True)
    (tmp_path / hidden).write_text("")
    result = start(tmp_path, how)
    assert result.returncode
    printed = result.stdout + result.stderr
    assert "hides drivezoo's own package" in printed
    assert str(tmp_path / hidden) in printed
    assert "rename it" in printed


@pytest.mark.parametrize("how", STARTS)
def test_what_hides_nothing_is_left_alone(how: str, tmp_path: Path) -> None:
    for beside in ("simulator.py", "simulator/__init__.py", "zoo/notes.txt"):
        (tmp_path / beside).parent.mkdir(exist_ok=True)
        (tmp_path / beside).write_text("")
    result = start(tmp_path, how)
    assert result.returncode == 0, result.stderr

"""Which libraries a command imports."""

import json
import subprocess
import sys
from pathlib import Path

from tests.zoo.command_runs import environment
from zoo.base.console_script import commands

DRIVING = """
import sys
import zoo.checkpoints.checkpoint_policy, zoo.server.live_page, zoo.scoring.evaluation
import zoo.scoring.visual_backprop
print(*{"albumentations", "lightning", "torchmetrics"} & {*sys.modules})
"""


def test_driving_imports_no_library_that_only_training_needs() -> None:
    """They would make `zoo.commands.drive` and `zoo.commands.evaluate` start two seconds later."""
    done = subprocess.run(
        [sys.executable, "-c", DRIVING], capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == []


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
)


def test_a_wrong_path_is_reported_before_torch_is_imported(tmp_path: Path) -> None:
    typed = [words for words in TYPOS if words.partition(" ")[0] in commands()]
    command = [sys.executable, "-c", WRONG, *typed]
    subprocess.run(command, cwd=tmp_path, env=environment(), check=True, timeout=60)
    status = next(tmp_path.glob("outputs/*/*/status.json"))
    assert json.loads(status.read_text())["status"] == "failed"

"""Which libraries a command imports."""

import subprocess
import sys

DRIVING = """
import sys
import zoo.checkpoints.policy, zoo.drive.live_page, zoo.evaluate.evaluation
import zoo.saliency.visual_backprop
print(*{"albumentations", "lightning", "torchmetrics"} & {*sys.modules})
"""


def test_driving_imports_no_library_that_only_training_needs() -> None:
    """They would make `zoo.drive` and `zoo.evaluate` start two seconds later."""
    done = subprocess.run(
        [sys.executable, "-c", DRIVING], capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == []

"""The commands as functions, for notebooks and scripts: `import drivezoo as zoo`.

Importing is cheap: each function imports torch and the simulator when it is called.
"""

from datamodules.errors import InputError, UsageError
from drivezoo.functions import (
    benchmark,
    compare,
    drive,
    evaluate,
    leaderboard,
    replay,
    results,
    train,
)
from drivezoo.policies import load_policy, policy
from zoo import __version__
from zoo.cli.stop_errors import StoppedError

__all__ = [
    "InputError",
    "StoppedError",
    "UsageError",
    "__version__",
    "benchmark",
    "compare",
    "drive",
    "evaluate",
    "leaderboard",
    "load_policy",
    "policy",
    "replay",
    "results",
    "train",
]

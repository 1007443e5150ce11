"""The commands as functions, for notebooks and scripts: `import drivezoo as zoo`.

Importing is cheap: each function imports torch and the simulator's renderer when it is called. It
registers the Gymnasium environments, such as `Lake-v0`.
"""

import simulator  # noqa: F401 - registers the environments
from drivezoo.functions import (
    benchmark,
    compare,
    drive,
    evaluate,
    leaderboard,
    load_policy,
    policy,
    read_benchmark,
    read_run,
    replay,
    results,
    train,
    write_table,
)
from zoo import __version__
from zoo.base.errors import InputError, StoppedError, UsageError

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
    "read_benchmark",
    "read_run",
    "replay",
    "results",
    "train",
    "write_table",
]

"""The commands as functions, for notebooks and scripts: `import drivezoo as zoo`.

Importing is cheap: the functions are imported when the first is used, torch and the simulator's
renderer when one is called. It registers the Gymnasium environments, such as `drivezoo/Lake-v0`.
"""

from typing import TYPE_CHECKING, Any

import zoo.simulator  # noqa: F401 - registers the environments
from zoo import __version__
from zoo.base.errors import InputError, StoppedError, UsageError

if TYPE_CHECKING:
    from drivezoo.functions import (
        benchmark,
        challenge,
        compare,
        drive,
        drive_road,
        evaluate,
        expert,
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

__all__ = [
    "InputError",
    "StoppedError",
    "UsageError",
    "__version__",
    "benchmark",
    "challenge",
    "compare",
    "drive",
    "drive_road",
    "evaluate",
    "expert",
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


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module 'drivezoo' has no attribute {name!r}")
    from drivezoo import functions  # slow import

    return getattr(functions, name)


def __dir__() -> list[str]:
    return __all__

"""The commands as functions, for notebooks and scripts: `import drivezoo as zoo`.

Importing is cheap: the functions are imported when the first is used, torch and the simulator's
renderer when one is called. It registers the Gymnasium environments, such as `drivezoo/Lake-v0`.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Any

try:
    import zoo.simulator
except ImportError as error:
    import zoo as _found  # a user's file or folder, beside a script or a notebook, is found first

    if Path(str(_found.__file__)).parents[1] == Path(__file__).parents[1]:
        raise
    raise ImportError(
        f"{_found.__file__}: hides drivezoo's own package zoo; rename it, or start Python elsewhere"
    ) from error
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

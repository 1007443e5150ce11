"""The commands as functions, for notebooks and scripts: `import drivezoo as zoo`.

Importing is cheap: each function imports torch and the simulator when it is called.
"""

from datamodules.errors import InputError, UsageError
from drivezoo.functions import (
    evaluate,
    train,
)
from zoo import __version__
from zoo.cli.stop_errors import StoppedError

__all__ = [
    "InputError",
    "StoppedError",
    "UsageError",
    "__version__",
    "evaluate",
    "train",
]

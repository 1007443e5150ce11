"""How much a command prints: `-q` less, `-v` more.

An environment variable keeps the choice, so that processes which a command starts make it, too.
"""

import os
from collections.abc import Sequence

VARIABLE = "DRIVEZOO_VERBOSITY"
FLAGS = {"-q": "quiet", "--quiet": "quiet", "-v": "verbose", "--verbose": "verbose"}


def take_verbosity(arguments: Sequence[str]) -> list[str]:
    """Return the arguments without `-q` and `-v`, and keep the last of these."""
    for flag in arguments:
        if flag in FLAGS:
            os.environ[VARIABLE] = FLAGS[flag]
    return [one for one in arguments if one not in FLAGS]


def is_quiet() -> bool:
    """Return whether progress and hints are left out."""
    return os.environ.get(VARIABLE) == "quiet"


def is_verbose() -> bool:
    """Return whether a sweep prints each job's output, and an error its traceback."""
    return os.environ.get(VARIABLE) == "verbose"

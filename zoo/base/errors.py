"""Exceptions caused by a user's input; commands print them as one line, without a traceback."""

import re

LONG = re.compile(r"[^\s/\\]{300,}")  # longer than any name of a file, which has at most 255


class InputError(Exception):
    """An error of bad input, in one line: the file, the row, what was found, and the fix.

    A value of 300 characters or more is cut to its begin and its length.

    >>> print(InputError("a.json: row " + 400 * "9" + " is no number"))
    a.json: row 9999999999...(400 characters) is no number
    """

    def __init__(self, message: object) -> None:
        super().__init__(LONG.sub(_cut, str(message)))

    def _render_traceback_(self) -> list[str]:
        """Return what notebooks print in place of a traceback."""
        return [f"{type(self).__name__}: {self}"]


class UsageError(InputError):
    """An error of wrong use: a key, choice or argument does not exist or does not fit.

    Commands exit with 2 for it, and with 1 for other bad input.
    """


class StoppedError(Exception):
    """An interrupt by the user; the message names the command that resumes."""


class PrunedError(Exception):
    """A decision of a search to stop an unpromising training."""


def _cut(value: re.Match) -> str:
    return f"{value[0][:10]}...({len(value[0])} characters)"

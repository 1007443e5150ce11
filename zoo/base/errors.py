"""Exceptions caused by a user's input; commands print them as one line, without a traceback."""


class InputError(Exception):
    """An error of bad input, in one line: the file, the row, what was found, and the fix."""

    def _render_traceback_(self) -> list[str]:
        """Return what notebooks print in place of a traceback."""
        return [f"{type(self).__name__}: {self}"]


class UsageError(InputError):
    """An error of wrong use: a key, choice or argument does not exist or does not fit.

    Commands exit with 2 for it, and with 1 for other bad input.
    """

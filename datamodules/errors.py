"""The one exception that a user's input can cause, printed as one line and never as a trace."""


class InputError(Exception):
    """Bad input, in one line: the file, the row, what was found, and the fix."""

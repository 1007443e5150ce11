"""The one exception that a user's input can cause, printed as one line and never as a trace."""


class InputError(Exception):
    """Bad input. The message is one line that names the file, the row, what was found and the fix."""

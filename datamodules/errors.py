"""The exceptions that a user's input can cause, printed as one line and never as a trace."""


class InputError(Exception):
    """Bad input, in one line: the file, the row, what was found, and the fix."""


class UsageError(InputError):
    """A command that cannot be meant: a key, a choice or an argument that does not exist or fit.

    Commands exit with 2 for it, and with 1 for other input that they cannot use.
    """

"""The exceptions that a user's input can cause, printed as one line and never as a trace."""


class SimulatorError(Exception):
    """Bad input, in one line: the file, the key or the folder, what was found, and the fix."""


class UsageError(SimulatorError):
    """A command that cannot be meant, for which commands exit with 2."""

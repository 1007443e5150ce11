"""Exceptions for bad user input; commands print them as one line without a traceback."""


class SimulatorError(Exception):
    """Bad input: one line that names the file, key or folder, what was found, and the fix."""


class UsageError(SimulatorError):
    """Wrong use of a command, such as an unknown option; the command exits with 2."""

"""The one exception that a user's input can cause, printed as one line and never as a trace."""


class SimulatorError(Exception):
    """Bad input, in one line: the file, the key or the folder, what was found, and the fix."""

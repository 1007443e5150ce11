"""Errors that end a training on request."""


class StoppedError(Exception):
    """An interrupt by the user; the message names the command that resumes."""


class PrunedError(Exception):
    """A decision of a search to stop an unpromising training."""

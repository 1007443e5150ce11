"""Errors that end a training without being a failure of the program."""


class StoppedError(Exception):
    """A person stopped the training; the message says how to go on."""


class PrunedError(Exception):
    """A search gave this training up for others that promise more."""

"""Ctrl-C while Python still imports a command's modules: one line instead of an import's trace."""

import os
import signal
import sys


def stop_quietly() -> None:
    """Let Ctrl-C end the process in one line, unless something else has been set for it."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _stop)


def raise_again() -> None:
    """Let Ctrl-C raise KeyboardInterrupt again, which a command handles."""
    if signal.getsignal(signal.SIGINT) is _stop:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _stop(*_: object) -> None:
    os.write(sys.__stderr__.fileno() if sys.__stderr__ else 2, b"zoo: stopped\n")
    os._exit(130)

"""What a check found."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

OK, WARNING, FAULT = "ok", "warning", "fault"


@dataclass(frozen=True)
class Finding:
    """A row of the doctor's table.

    Attributes:
        state: `ok`, `warning` (works, with a drawback) or `fault` (something will not work).
        what: the thing looked at, in a word or two.
        found: what was found, in a line.
        fix: what to do about it; empty where nothing need be done.
    """

    state: str
    what: str
    found: str
    fix: str = ""


def from_error(what: str, error: Exception, usual_fix: str) -> Finding:
    """The fault that one of our own errors tells: `what was found; what to do`, or else the
    usual fix."""
    text = " ".join(str(error).split())
    found, _, fix = text.rpartition("; ")
    return Finding(FAULT, what, found or text, fix if found else usual_fix)


def careful(what: str, check: Callable[[], Iterator[Finding]]) -> Iterator[Finding]:
    """The findings of a check; what it raises becomes one more, never a trace."""
    try:
        yield from check()
    except ModuleNotFoundError as error:
        yield Finding(FAULT, what, f"not looked at: {error.name} is not installed", INSTALL)
    except Exception as error:  # a library that is damaged can raise anything
        reason = " ".join(str(error).split()) or "no reason given"
        yield Finding(FAULT, what, f"the check failed: {type(error).__name__}: {reason}", INSTALL)


INSTALL = "in the checkout, make sure of the environment: pip install -e ."

"""The result of a check, and the conversion of errors to results."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

OK, WARNING, FAULT = "ok", "warning", "fault"


@dataclass(frozen=True)
class Finding:
    """A row of the doctor's table.

    Attributes:
        state: `ok`, `warning` (works, with a drawback) or `fault` (something does not work).
        what: subject of the check, in a word or two.
        found: result of the check, in one line.
        fix: action for the user; empty where none is needed.
    """

    state: str
    what: str
    found: str
    fix: str = ""


def from_error(what: str, error: Exception, usual_fix: str) -> Finding:
    """Convert one of our errors, `what was found; what to do`, to a fault.

    An error without the second part gets the usual fix.
    """
    text = " ".join(str(error).split())
    found, _, fix = text.rpartition("; ")
    return Finding(FAULT, what, found or text, fix if found else usual_fix)


def careful(what: str, check: Callable[[], Iterator[Finding]]) -> Iterator[Finding]:
    """Yield the findings of a check; an exception becomes a finding, not a traceback."""
    try:
        yield from check()
    except ModuleNotFoundError as error:
        yield Finding(FAULT, what, f"not checked: {error.name} is not installed", INSTALL)
    except Exception as error:  # a damaged library can raise anything
        reason = " ".join(str(error).split()) or "no reason given"
        yield Finding(FAULT, what, f"the check failed: {type(error).__name__}: {reason}", INSTALL)


INSTALL = "activate the virtual environment, then in the checkout: pip install -e ."

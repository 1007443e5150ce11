"""Exceptions caused by a user's input, and the nearest existing name as a hint for a typo.

Commands print them as one line, without a traceback.
"""

import difflib
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

LONG = re.compile(r"[^\s/\\]{300,}")  # longer than any name of a file, which has at most 255
SHOWN = 15  # most names that a hint lists if none is near


class InputError(Exception):
    """An error of bad input, in one line: the file, the row, what was found, and the fix.

    A value of 300 characters or more is cut to its begin and its length.

    >>> print(InputError("a.json: row " + 400 * "9" + " is no number"))
    a.json: row 9999999999...(400 characters) is no number
    """

    def __init__(self, message: object) -> None:
        super().__init__(LONG.sub(_cut, re.sub(r"\s*\n\s*", " ", str(message))))

    def _render_traceback_(self) -> list[str]:
        """Return what notebooks print in place of a traceback."""
        return [f"{type(self).__name__}: {self}"]


class UsageError(InputError):
    """An error of wrong use: a key, choice or argument does not exist or does not fit.

    Commands exit with 2 for it, and with 1 for other bad input.
    """


class StoppedError(Exception):
    """An interrupt by the user; the message names the command that resumes."""


class PrunedError(Exception):
    """A decision of a search to stop an unpromising training."""


def _cut(value: re.Match) -> str:
    return f"{value[0][:10]}...({len(value[0])} characters)"


@contextmanager
def file_errors(named: object, form: str = "{}; name another file") -> Iterator[None]:
    """Raise InputError for an OSError within the block.

    Args:
        named: file or folder, and the key that names it, for the message.
        form: text after the name, with `{}` for the reason.

    >>> with file_errors("out=a.csv"):
    ...     raise OSError(28, "No space left on device")
    Traceback (most recent call last):
    zoo.base.errors.InputError: out=a.csv: No space left on device; name another file
    """
    try:
        yield
    except OSError as error:
        raise InputError(f"{named}: {form.replace('{}', str(error.strerror or error))}") from None


@contextmanager
def library_errors(file: object, fault: str, remedy: str) -> Iterator[None]:
    """Raise InputError for any error that a library raises at a damaged file within the block.

    Args:
        file: file that the library reads.
        fault: what is wrong with the file, where no system error says it.
        remedy: what the user can do.
    """
    try:
        yield
    except (InputError, ImportError, MemoryError):
        raise
    except Exception as error:  # damaged bytes make libraries raise errors of any type
        # What imageio-ffmpeg adds begins with ffmpeg's own version and options.
        reason = " ".join(str(error).partition("=== stderr")[0].split()) or type(error).__name__
        system = error.strerror if isinstance(error, OSError) else None
        raise InputError(f"{file}: {system or f'{fault} ({reason:.200})'}; {remedy}") from None


@contextmanager
def placed_errors(source: object) -> Iterator[None]:
    """Raise an InputError within the block again, of its kind, with its place in front."""
    try:
        yield
    except InputError as error:
        raise type(error)(f"{source}: {error}") from None


@contextmanager
def optional_import(line: str) -> Iterator[None]:
    """Raise InputError with a line for a package that the block imports and that is missing."""
    try:
        yield
    except ImportError:
        raise InputError(line) from None


def hint(word: str, choices: Iterable[str], remedy: str = "") -> str:
    """Return the known names nearest to a typo; without any, all names or the remedy.

    A name of the same letters is the nearest. The last part of a dotted name is compared, too:
    `ofset` is near `data.offset`.

    >>> hint("lap", ["laps", "seeds"])
    'did you mean laps?'
    >>> hint("modle", ["module", "model"])
    'did you mean model or module?'
    """
    names = list(choices)
    by_tail = {name.rpartition(".")[2]: name for name in reversed(names)}
    near = [name for name in names if name != word and sorted(name) == sorted(word)][:1]
    near = near or difflib.get_close_matches(word, names, n=1, cutoff=0.6)
    tail = difflib.get_close_matches(word.rpartition(".")[2], list(by_tail), n=2, cutoff=0.7)
    near += [by_tail[name] for name in tail if by_tail[name] not in near]
    if near:
        return f"did you mean {' or '.join(near[:2])}?"
    if len(names) < SHOWN or not remedy:
        return f"available: {', '.join(names)}" if names else remedy or "none available"
    return remedy

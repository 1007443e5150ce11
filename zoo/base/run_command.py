"""Run of a command: one-line errors and exit statuses."""

import re
import sys
import traceback
from collections.abc import Callable

from zoo.base.early_interrupt import raise_again
from zoo.base.errors import InputError, StoppedError, UsageError
from zoo.base.standard_output import forgiving_output
from zoo.base.terminal import error_line
from zoo.base.verbosity import is_verbose, take_verbosity

FAILED, WRONG_USE, STOPPED = 1, 2, 130  # exit statuses; 0 is success

# Limits on an argument; beyond them parsers take minutes or raise errors of their own.
MOST_PATH = 4096  # characters without a comma or a bracket: Linux' limit of a path
MOST_DIGITS = 4300  # digits of a number: Python's limit
MOST_LEVELS = 64  # levels of nested brackets

# Messages of libraries' own error classes when the system has no more memory.
_MEMORY = re.compile(
    "can.t allocate memory|Insufficient memory|failed to map segment|can.t start new thread"
)


def run_command(
    name: str,
    command: Callable[[list[str]], None],
    arguments: list[str],
    explain: Callable[[BaseException, list[str]], Exception | None] | None = None,
) -> int:
    """Call `command(arguments)`, print an error as one line, and return the exit status.

    A failure of standard output does not end the command; it is reported at the end.

    Args:
        name: text before an error.
        command: function to call.
        arguments: arguments of the shell; `-q` and `-v` are taken out.
        explain: function that returns an error of one line for an error, or None for a bug;
            `expected_failure` without it.
    """
    failure: Exception | None = None
    try:
        with forgiving_output():
            raise_again()
            check_arguments(arguments)
            command(take_verbosity(arguments))
    except KeyboardInterrupt:
        failure = StoppedError("stopped")
    except BaseException as error:  # a part may raise any
        failure = (explain or expected_failure)(error, arguments)
        if failure is None and not isinstance(error, Exception):
            raise
        if failure is None:
            traceback.print_exc()
            print(
                f"{name}: this is a bug in drivezoo; please report it with the command and the "
                "lines above",
                file=sys.stderr,
            )
            return FAILED
    if failure is None:
        return 0
    if is_verbose():
        traceback.print_exception(failure)
    print(error_line(name, failure), file=sys.stderr)
    if isinstance(failure, StoppedError):
        return STOPPED
    return WRONG_USE if isinstance(failure, UsageError) else FAILED


def expected_failure(error: BaseException, arguments: list[str]) -> Exception | None:
    """Return an error of one line for input that the user can fix, or a stop; else None."""
    if isinstance(error, InputError | StoppedError):
        return error
    if was_stopped(error):
        return StoppedError("stopped")
    if isinstance(error, MemoryError) or _MEMORY.search(str(error)):
        return InputError(
            "not enough memory; close other programs, or ask for less: in a training a smaller "
            "data.batch_size, data.workers=0 or a smaller model"
        )
    if isinstance(error, RecursionError):
        return InputError("an argument or a file is nested too deeply; use fewer levels")
    if isinstance(error, OSError) and error.strerror is not None:
        return InputError(f"{error.filename or 'a file'}: {error.strerror}")
    return None


def was_stopped(error: BaseException | None) -> bool:
    """Return whether Ctrl-C caused an error that a library raised in place of it.

    >>> was_stopped(ImportError("numpy")), was_stopped(KeyboardInterrupt())
    (False, True)
    """
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None


def check_arguments(arguments: list[str]) -> None:
    """Raise UsageError for an argument that is too long or too deeply nested to parse."""
    for argument in arguments:
        begin = ascii(argument[:40])
        if "\0" in argument:
            raise UsageError(f"{begin}: contains a NUL character; remove it")
        if any("/" in part for part in re.findall(rf"[^,\[\]]{{{MOST_PATH + 1},}}", argument)):
            raise UsageError(f"{begin}...: a path has {MOST_PATH:,} characters at most; shorten it")
        if re.search(rf"\d{{{MOST_DIGITS + 1}}}", argument):
            raise UsageError(f"{begin}...: a number has {MOST_DIGITS:,} digits at most; shorten it")
        depth = 0
        for bracket in re.findall(r"[\[({})\]]", argument):
            depth += 1 if bracket in "[({" else -1
            if depth > MOST_LEVELS:
                raise UsageError(
                    f"{begin}...: brackets are nested {MOST_LEVELS} deep at most; use fewer"
                )

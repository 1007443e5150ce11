"""Run of a command: Ctrl-C, standard output, one-line errors and exit statuses."""

import atexit
import errno
import gc
import os
import re
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from typing import NoReturn, TextIO

from zoo.base.errors import InputError, StoppedError, UsageError
from zoo.base.parts import part_failure, take_parts
from zoo.base.terminal import error_line, guard_rich, is_verbose, printable, take_verbosity

FAILED, WRONG_USE, STOPPED = 1, 2, 130  # exit statuses; 0 is success
VERSION = ("--version", "-V")
AGAIN_S = 0.05

# Messages of libraries' own error classes when the system has no more memory.
_MEMORY = re.compile(
    "can.t allocate memory|Insufficient memory|failed to map segment|can.t start new thread"
)
# Messages of Python's own errors for what a user typed.
_TYPED = {
    "home directory": "a path begins with ~ and the name of no user; give the whole path",
    "'idna' codec": "a part of a host's name is empty or too long; correct the host",
}


def run_command(name: str, command: Callable[[list[str]], object], arguments: list[str]) -> int:
    """Call `command(arguments)`, print an error as one line, and return the exit status.

    A failure of standard output does not end the command; it is reported at the end.

    Args:
        name: text before an error.
        command: function to call.
        arguments: arguments of the shell; `-q`, `-v` and `parts=` are taken out.
    """
    failure: Exception | None = None
    try:
        with forgiving_output():
            raise_interrupts()
            os.environ["NO_ALBUMENTATIONS_UPDATE"] = "1"
            guard_rich()
            words = take_parts(take_verbosity(arguments))
            if set(words).isdisjoint(VERSION):
                command(words)
            else:
                print(version_line())
    except BaseException as error:  # a part may raise any
        failure = expected_failure(error)
        if failure is None and not isinstance(error, Exception):
            raise
        if failure is None or is_verbose():
            print(*map(printable, traceback.format_exc().splitlines()), sep="\n", file=sys.stderr)
        if failure is None:
            bug = "this is a bug in drivezoo; please report it with the command and the lines above"
            print(f"{name}: {bug}", file=sys.stderr)
            return FAILED
    if failure is None:
        return 0
    print(error_line(name, failure), file=sys.stderr)
    if isinstance(failure, StoppedError):
        return STOPPED
    return WRONG_USE if isinstance(failure, UsageError) else FAILED


def expected_failure(error: BaseException) -> Exception | None:
    """Return an error of one line for input that the user can fix, or a stop; else None."""
    if isinstance(error, InputError | StoppedError):
        return error
    if was_stopped(error):
        return StoppedError("stopped")
    if failure := part_failure(error):
        return failure
    if isinstance(error, MemoryError) or _MEMORY.search(str(error)):
        return InputError(
            "not enough memory; close other programs, or ask for less: in a training a smaller "
            "data.batch_size, data.workers=0 or a smaller model"
        )
    if isinstance(error, RecursionError):
        return InputError("an argument or a file is nested too deeply; use fewer levels")
    if isinstance(error, RuntimeError | UnicodeError):
        return next((InputError(line) for word, line in _TYPED.items() if word in str(error)), None)
    if isinstance(error, OSError) and error.strerror is not None:
        return InputError(f"{error.filename or 'a file'}: {error.strerror}")
    return None


def exit_after(name: str, command: Callable[[list[str]], object]) -> NoReturn:
    """Run a command with the arguments of this process, and exit with its status."""
    # Python would look through each object of PyTorch and Lightning once more, for over a second.
    atexit.register(gc.freeze)
    # An interrupt before the command begins, or while Python ends, would print a traceback.
    atexit.register(signal.signal, signal.SIGINT, signal.SIG_IGN)
    try:
        status = run_command(name, command, sys.argv[1:])
    except KeyboardInterrupt:
        print(f"{name}: stopped", file=sys.stderr)
        status = STOPPED
    sys.exit(status)


def raise_interrupts() -> None:
    """Let Ctrl-C raise KeyboardInterrupt, also if it arrives in a finalizer or callback.

    So do the signals by which a terminal or a scheduler announces the end.
    """
    if signal.getsignal(signal.SIGINT) is stop_in_one_line:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    for name in ("SIGHUP", "SIGTERM", "SIGUSR1"):  # Windows has SIGTERM alone
        number = getattr(signal, name, None)
        if number and signal.getsignal(number) is signal.SIG_DFL:  # else it is ignored, as by nohup
            signal.signal(number, _interrupt)
    if sys.platform == "win32":  # where a process can send no Ctrl-C to one other process
        signal.signal(signal.SIGBREAK, signal.default_int_handler)
    if sys.unraisablehook is sys.__unraisablehook__:
        sys.unraisablehook = _interrupt_again


def _interrupt(number: int, _: object) -> None:
    """Raise KeyboardInterrupt, unless Lightning handles the signal, which completes the batch."""
    if signal.getsignal(number) is _interrupt:
        raise KeyboardInterrupt


@contextmanager
def held_interrupt() -> Iterator[None]:
    """Deliver a Ctrl-C that arrives meanwhile at the end; processes started here ignore it."""
    asked: list[int] = []
    is_main = threading.current_thread() is threading.main_thread()
    if is_main:
        before = signal.signal(signal.SIGINT, lambda *_: asked.append(1))
    if hasattr(signal, "pthread_sigmask"):  # a new process inherits the mask
        block = signal.SIG_BLOCK  # type: ignore[attr-defined,unused-ignore]
        mask = signal.pthread_sigmask(block, [signal.SIGINT])
    try:
        yield
    finally:
        if hasattr(signal, "pthread_sigmask"):
            back = signal.SIG_SETMASK  # type: ignore[attr-defined,unused-ignore]
            signal.pthread_sigmask(back, mask)
        if is_main:
            signal.signal(signal.SIGINT, before)
    if asked:
        signal.raise_signal(signal.SIGINT)


def stop_in_one_line(*_: object) -> None:
    """End this process at a Ctrl-C that arrives before a command is imported."""
    os.write(2, b"drivezoo: stopped\n")
    os._exit(STOPPED)


def _interrupt_again(unraisable: "sys.UnraisableHookArgs") -> None:
    """Deliver a Ctrl-C again that arrived in a finalizer or callback, which cannot raise it."""
    if unraisable.exc_type is not KeyboardInterrupt:
        sys.__unraisablehook__(unraisable)
        return
    if hasattr(signal, "pthread_kill"):
        # To the main thread: a signal to the timer's would not wake it from a system call.
        main = threading.main_thread().ident
        timer = threading.Timer(AGAIN_S, signal.pthread_kill, [main, signal.SIGINT])
    else:  # Windows, where a signal of any thread wakes the main thread
        timer = threading.Timer(AGAIN_S, signal.raise_signal, [signal.SIGINT])
    timer.daemon = True
    timer.start()


def version_line() -> str:
    """Return the package's version with those of Python and PyTorch, without importing it."""
    from importlib.metadata import version  # slow import

    from zoo.base import __version__

    return f"drivezoo {__version__} (Python {sys.version.split()[0]}, torch {version('torch')})"


def was_stopped(error: BaseException | None) -> bool:
    """Return whether Ctrl-C caused an error that a library raised in place of it.

    >>> was_stopped(ImportError("numpy")), was_stopped(KeyboardInterrupt())
    (False, True)
    """
    chain: list[BaseException] = []
    while error is not None and error not in chain:  # a cause that is raised again closes a circle
        chain.append(error)
        error = error.__cause__ or error.__context__
    return any(isinstance(link, KeyboardInterrupt) for link in chain)


@contextmanager
def forgiving_output() -> Iterator[None]:
    """Print to standard output within the block; what cannot be printed does not end it.

    A pipe that its reader closed, as `| head` does, is no failure.

    Raises:
        InputError: after the block, if something could not be printed.
    """
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")  # a terminal's encoding may lack some characters
    before = sys.stdout
    if before is None:  # the shell closed it: `>&-`; argparse would print to standard error
        with Path(os.devnull).open("w", encoding="utf-8") as nothing, redirect_stdout(nothing):
            yield
        return
    output = ForgivingOutput(before)
    sys.stdout = output
    try:
        try:
            yield
        finally:
            output.flush()
            sys.stdout = before
    except SystemExit as end:  # such as argparse's after its help
        if end.code or not output.failure:
            raise
    if output.failure:
        raise InputError(
            f"standard output: {output.failure.strerror}; the command finished, but some lines "
            "were not printed: redirect them to a disk with free space"
        )


class ForgivingOutput:
    """A text stream that forwards to another one and keeps its first error.

    Attributes:
        failure: first error of writing; None if everything was written.
    """

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream
        self.failure: OSError | None = None

    def __getattr__(self, name: str) -> object:
        return getattr(self.stream, name)

    def write(self, text: str) -> int:
        """Write a text; escape characters that the stream's encoding lacks."""
        try:
            self.stream.write(text)
        except UnicodeEncodeError:
            encoding = self.stream.encoding or "ascii"
            self.write(text.encode(encoding, "backslashreplace").decode(encoding))
        except OSError as error:
            self._failed(error)
        return len(text)

    def flush(self) -> None:
        """Flush the stream."""
        try:
            self.stream.flush()
        except OSError as error:
            self._failed(error)

    def _failed(self, error: OSError) -> None:
        # The rest of the buffer would fail again, at the latest when Python exits.
        os.dup2(os.open(os.devnull, os.O_WRONLY), self.stream.fileno())
        if error.errno not in (errno.EPIPE, errno.EINVAL):  # the latter for a pipe on Windows
            self.failure = self.failure or error

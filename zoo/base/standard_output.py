"""Standard output of all commands: its failures, such as a full disk, do not end a training."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from typing import TextIO

from zoo.base.errors import InputError


class ClosedOutputError(Exception):
    """The closed pipe of a reading program, as after `| head`.

    It is no BrokenPipeError, for which rich ends the process with 1.
    """


@contextmanager
def forgiving_output() -> Iterator[None]:
    """Print to standard output within the block; a pipe that its reader closed ends the block.

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
    except ClosedOutputError:
        return
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

    def writelines(self, lines: list[str]) -> None:
        """Write each line."""
        for line in lines:
            self.write(line)

    def flush(self) -> None:
        """Flush the stream."""
        try:
            self.stream.flush()
        except OSError as error:
            self._failed(error)

    def _failed(self, error: OSError) -> None:
        # The rest of the buffer would fail again, at the latest when Python exits.
        os.dup2(os.open(os.devnull, os.O_WRONLY), self.stream.fileno())
        if isinstance(error, BrokenPipeError):
            raise ClosedOutputError from error
        self.failure = self.failure or error

"""Standard output that ends no training: what cannot be printed is left out."""

import os
from typing import TextIO


class ForgivingOutput:
    """A text stream like the one within, whose failures are kept for the end.

    A reader that has gone, as of `| head`, still raises BrokenPipeError.

    Attributes:
        failure: why something was not written; None where all was.
    """

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream
        self.failure: OSError | None = None

    def __getattr__(self, name: str) -> object:
        return getattr(self.stream, name)

    def write(self, text: str) -> int:
        """Write, with escapes for what the stream's encoding has no signs for."""
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
        """Flush what was written."""
        try:
            self.stream.flush()
        except OSError as error:
            self._failed(error)

    def _failed(self, error: OSError) -> None:
        if isinstance(error, BrokenPipeError):
            raise error
        self.failure = self.failure or error
        # What is still in the buffer would fail again, at the latest when Python ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), self.stream.fileno())

"""Standard output whose failures, such as a full disk, do not end a training."""

import os
from typing import TextIO


class ForgivingOutput:
    """A text stream that forwards to another one and keeps its first error.

    A closed pipe, as after `| head`, still raises BrokenPipeError.

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
        if isinstance(error, BrokenPipeError):
            raise error
        self.failure = self.failure or error
        # The rest of the buffer would fail again, at the latest when Python exits.
        os.dup2(os.open(os.devnull, os.O_WRONLY), self.stream.fileno())

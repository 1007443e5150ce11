"""Terminal log of the driver: each kind of trouble is printed once, then counted."""

from collections import Counter
from collections.abc import Callable

from zoo.base.terminal import printable

MOST_DETAIL = 300  # characters


class Notices:
    """Log that prints the first events of each kind and counts all.

    Args:
        write: function that prints a line; None for `print`.

    Attributes:
        counts: number of troubles by kind.

    >>> notices = Notices()
    >>> notices.report("image cannot be read", "the file is empty")
    image cannot be read: the file is empty (printed once, then counted)
    >>> notices.report("image cannot be read", "the image is truncated")
    >>> dict(notices.counts)
    {'image cannot be read': 2}
    """

    def __init__(self, write: Callable[[str], None] | None = None) -> None:
        self._write = write or (lambda line: print(line, flush=True))
        self.counts: Counter[str] = Counter()
        self._printed: Counter[str] = Counter()

    def print(self, line: str) -> None:
        """Print a line without control characters, which a client may have sent."""
        self._write(printable(line))

    def report(self, kind: str, detail: str = "") -> None:
        """Count a trouble, and print the first of its kind.

        Args:
            kind: kind of the trouble, in words.
            detail: what happened this time; printed in one line.
        """
        self.counts[kind] += 1
        if self.counts[kind] == 1:
            detail = " ".join(detail.split())
            if len(detail) > MOST_DETAIL:
                detail = f"{detail[:MOST_DETAIL]}..."
            self.print(f"{kind}{': ' if detail else ''}{detail} (printed once, then counted)")

    def print_some(self, kind: str, line: str, most: int = 10) -> None:
        """Print an ordinary event, such as a new client, up to `most` times for its kind."""
        self._printed[kind] += 1
        if self._printed[kind] <= most:
            self.print(line + (" (more are not printed)" if self._printed[kind] == most else ""))

    def count_lines(self) -> list[str]:
        """Return a line for each kind of trouble that occurred more than once."""
        return [f"{count:,} times: {kind}" for kind, count in self.counts.items() if count > 1]

"""What the driver tells the person at the terminal: each kind of trouble once, then counted."""

from collections import Counter
from collections.abc import Callable

from datamodules.terminal import printable

MOST_DETAIL = 300  # characters


class Notices:
    """Says a kind's first few events, and counts them all.

    >>> notices = Notices()
    >>> notices.say("image cannot be read", "the file is empty")
    image cannot be read: the file is empty (said once, then counted)
    >>> notices.say("image cannot be read", "the image is truncated")
    >>> dict(notices.counts)
    {'image cannot be read': 2}
    """

    def __init__(self, tell: Callable[[str], None] | None = None) -> None:
        self._tell = tell or (lambda line: print(line, flush=True))
        self.counts: Counter[str] = Counter()
        self._told: Counter[str] = Counter()

    def tell(self, line: str) -> None:
        """Print a line; control characters that a client sent never reach the terminal."""
        self._tell(printable(line))

    def say(self, kind: str, detail: str = "") -> None:
        """Trouble of some kind: told the first time, with its detail in one line."""
        self.counts[kind] += 1
        if self.counts[kind] == 1:
            detail = " ".join(detail.split())
            if len(detail) > MOST_DETAIL:
                detail = f"{detail[:MOST_DETAIL]}..."
            self.tell(f"{kind}{': ' if detail else ''}{detail} (said once, then counted)")

    def tell_some(self, kind: str, line: str, most: int = 10) -> None:
        """An ordinary event, such as a client that connects: the first `most` are told."""
        self._told[kind] += 1
        if self._told[kind] <= most:
            self.tell(line + (" (and so on)" if self._told[kind] == most else ""))

    def count_lines(self) -> list[str]:
        """How often there was trouble of each kind, for the end of a drive."""
        return [f"{count:,} times: {kind}" for kind, count in self.counts.items() if count > 1]

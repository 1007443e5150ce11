"""How often the live page asks how the drive stands."""

POLL_MS = 100
MOST_POLLS = 50  # a second, of all pages together; 300 doubled the p99 of the driver's latency


class Pace:
    """How long each page waits before it asks again, so that a class that looks on does not slow
    the driving.

    Attributes:
        poll_ms: for each page; longer, the more there are.
    """

    def __init__(self) -> None:
        self.poll_ms = POLL_MS
        self._count, self._since_s = 0, 0.0

    def asked(self, now_s: float) -> None:
        """A page asks."""
        self._count += 1
        elapsed_s = now_s - self._since_s
        if elapsed_s >= 1:
            pages = self._count / elapsed_s * self.poll_ms / 1000
            self.poll_ms = round(max(POLL_MS, 1000 * pages / MOST_POLLS))
            self._count, self._since_s = 0, now_s

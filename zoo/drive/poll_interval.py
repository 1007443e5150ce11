"""Interval at which live pages poll the drive's state."""

POLL_MS = 100
MOST_POLLS = 50  # per second, of all pages; 300 doubled the 99th percentile of the latency


class PollInterval:
    """Poll interval that grows with the number of pages, so that they do not slow the driving.

    Attributes:
        poll_ms: milliseconds between two polls of a page.
    """

    def __init__(self) -> None:
        self.poll_ms = POLL_MS
        self._count, self._since_s = 0, 0.0

    def asked(self, now_s: float) -> None:
        """Count a poll of a page, and adapt `poll_ms` once a second.

        Args:
            now_s: time in seconds of a monotonic clock.
        """
        self._count += 1
        elapsed_s = now_s - self._since_s
        if elapsed_s >= 1:
            pages = self._count / elapsed_s * self.poll_ms / 1000
            self.poll_ms = round(max(POLL_MS, 1000 * pages / MOST_POLLS))
            self._count, self._since_s = 0, now_s

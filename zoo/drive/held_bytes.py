"""The bytes that clients' unfinished requests and messages hold, and what bounds their sum."""

from collections.abc import Callable, Hashable

MOST_HELD = 16 << 20  # bytes; an image of the limit takes 1.33 MB


class HeldBytes:
    """Bytes that each connection holds until its request or message is answered.

    Each of 512 connections that half-sends the longest message would hold 1 GB together.

    Args:
        give_way: lets the other connections have their turn, which frees what is answered by then.
        close: closes a connection, and releases what it holds. The largest message goes first, of
            equal ones the oldest: a simulator's message of some 20 kB is never the largest.
    """

    def __init__(self, give_way: Callable[[], None], close: Callable[[Hashable], None]) -> None:
        self._give_way, self._close = give_way, close
        self._sizes: dict[Hashable, int] = {}  # the one that began first is first
        self._total = 0

    def hold(self, key: Hashable, size: int) -> None:
        """Replace what a connection holds, and wait until all hold no more than `MOST_HELD`."""
        if size:
            self._total += size - self._sizes.get(key, 0)
            self._sizes[key] = size
        else:
            self.release(key)
        while self._total > MOST_HELD and key in self._sizes:
            self._give_way()
            if self._total > MOST_HELD and self._sizes:
                self._close(max(self._sizes, key=self._sizes.__getitem__))
                self._give_way()

    def release(self, key: Hashable) -> None:
        """Forget a connection that ended, or whose message is answered."""
        self._total -= self._sizes.pop(key, 0)

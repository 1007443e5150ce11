"""Limit of the memory that clients' unfinished requests and messages take."""

from collections.abc import Callable, Hashable

MOST_HELD = 16 << 20  # bytes; the largest allowed image takes 1.33 MB in base64


class HeldBytes:
    """Count of the bytes that each connection holds until its message is answered.

    Without a limit, 512 connections that send half of the longest message would hold 1 GB. The
    connection with the largest message is closed first, and the oldest of equal ones. A simulator's
    message of about 20 kB is then never the largest.

    Args:
        give_way: function that lets other connections run, which frees their answered messages.
        close: function that closes a connection and releases its bytes.
    """

    def __init__(self, give_way: Callable[[], None], close: Callable[[Hashable], None]) -> None:
        self._give_way, self._close = give_way, close
        self._sizes: dict[Hashable, int] = {}  # bytes by connection, the oldest first
        self._total = 0

    def hold(self, key: Hashable, size: int) -> None:
        """Set the bytes of a connection, and wait until the sum is at most `MOST_HELD`.

        Args:
            key: connection.
            size: bytes that it holds.
        """
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
        """Forget a connection that has ended, or whose message was answered."""
        self._total -= self._sizes.pop(key, 0)

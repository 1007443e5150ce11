"""Rows of a recording that a reader cannot use: refused, or left out, counted and named."""

from zoo.base.errors import InputError

HINTED_SHARE = 0.05  # share of bad rows from which a cause that all rows share is likely


class BadRows:
    """The rows of one recording that cannot be used.

    Args:
        on_bad_row: `fail` refuses the recording, `skip` leaves the rows out.

    Attributes:
        faults: place and fault of each bad row, in the order of the rows.
    """

    def __init__(self, on_bad_row: str = "fail") -> None:
        self._skips = on_bad_row == "skip"
        self.faults: list[str] = []

    def finish(self, good: int, hint: str = "") -> None:
        """Refuse the recording if a row is bad, unless bad rows are left out and others remain.

        Args:
            good: number of the other rows.
            hint: likely cause of many bad rows, and its remedy.

        Raises:
            InputError: names the first bad row, the number of bad rows, and the remedy.
        """
        bad, rows = len(self.faults), good + len(self.faults)
        if not bad or (self._skips and good):
            return
        first = self.faults[0]
        if bad > 1:
            first += f" ({bad:,} of {rows:,} rows are bad)"
        if hint and bad >= HINTED_SHARE * rows:
            raise InputError(f"{first}; {hint}")
        if bad == rows > 1:
            raise InputError(f"{first}; correct all rows, or name another recording")
        row, them = ("the row", "it") if bad == 1 else ("these rows", "them")
        raise InputError(
            f"{first}; correct or delete {row}, or leave {them} out with on_bad_row=skip "
            "(in a training data.on_bad_row=skip)"
        )

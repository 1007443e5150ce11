"""Result of a conversion between two formats."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Converted:
    """A converted recording.

    Attributes:
        folder: folder that was written.
        rows: number of rows in it.
        drives: number of continuous drives.
        notes: a line on each loss or assumption.
    """

    folder: Path
    rows: int
    drives: int
    notes: tuple[str, ...] = ()


def left_out_note(left_out: list[str], what: str) -> list[str]:
    """Return a note on rows that were left out, or none."""
    if not left_out:
        return []
    return [f"{len(left_out):,} rows left out: {what} (the first: {left_out[0]})"]

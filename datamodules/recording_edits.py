"""Edits of a recording by row: stretches to drop or mirror, and rows at which to split it.

All functions are pure: they return new edits and keep the old ones, which makes undo easy. A row
keeps its number, from 0, whatever is dropped before it. Users count rows from 1.
"""

import itertools
import re
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from datamodules.stretches import true_runs
from zoo.base.errors import UsageError

Stretch = tuple[int, int]  # first row, and the row after the last one

MOST_TEXT = 1_000_000  # characters of typed stretches
_TYPED = re.compile(r"(?P<first>\d{1,12})(?P<dash>-(?P<last>\d{1,12})?)?")


@dataclass(frozen=True)
class Edits:
    """Edits of a recording of `rows` rows.

    Attributes:
        rows: number of rows of the recording.
        dropped: stretches to leave out, sorted, without a common row.
        mirrored: stretches to mirror from left to right, in the same form.
        splits: rows with which a further part begins, sorted.
    """

    rows: int
    dropped: tuple[Stretch, ...] = ()
    mirrored: tuple[Stretch, ...] = ()
    splits: tuple[int, ...] = ()

    def kept(self) -> np.ndarray:
        """Return whether each row is kept, bool [rows]."""
        return ~_mask(self.dropped, self.rows)

    def parts(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return the rows of each part, int64 [n], and whether each is mirrored, bool [n].

        The mirrored rows follow the others. Readers take the step back in time for a pause, so no
        window of frames has both kinds. A part without rows is left out.
        """
        kept, mirrored = self.kept(), _mask(self.mirrored, self.rows)
        borders = [0, *self.splits, self.rows]
        parts = []
        for first, end in itertools.pairwise(borders):
            rows = first + np.flatnonzero(kept[first:end])
            turned = mirrored[rows]
            order = np.argsort(turned, kind="stable")
            if len(rows):
                parts.append((rows[order], turned[order]))
        return parts


def drop(edits: Edits, stretch: Stretch) -> Edits:
    """Leave out the rows of a stretch."""
    dropped = _mask(edits.dropped, edits.rows)
    dropped[_rows(edits, stretch)] = True
    return replace(edits, dropped=true_runs(dropped))


def restore(edits: Edits, stretch: Stretch) -> Edits:
    """Keep the rows of a stretch as they were recorded: neither dropped nor mirrored."""
    masks = _mask(edits.dropped, edits.rows), _mask(edits.mirrored, edits.rows)
    for mask in masks:
        mask[_rows(edits, stretch)] = False
    return replace(edits, dropped=true_runs(masks[0]), mirrored=true_runs(masks[1]))


def trim(edits: Edits, stretch: Stretch) -> Edits:
    """Leave out all rows before and after a stretch."""
    inside = _rows(edits, stretch)
    dropped = np.ones(edits.rows, bool)
    dropped[inside] = _mask(edits.dropped, edits.rows)[inside]
    return replace(edits, dropped=true_runs(dropped))


def mirror(edits: Edits, stretch: Stretch) -> Edits:
    """Mirror a stretch from left to right; mirror it back if all its rows are mirrored."""
    mirrored, rows = _mask(edits.mirrored, edits.rows), _rows(edits, stretch)
    mirrored[rows] = not mirrored[rows].all()
    return replace(edits, mirrored=true_runs(mirrored))


def split(edits: Edits, row: int) -> Edits:
    """Begin a further part with a row."""
    if not 0 < row < edits.rows:
        raise UsageError(f"split={row + 1}: must be a row in 2..{edits.rows}")
    return replace(edits, splits=tuple(sorted({*edits.splits, row})))


def merge(edits: Edits, stretch: Stretch) -> Edits:
    """Join the parts that begin within a stretch with the parts before them."""
    rows = _rows(edits, stretch)
    kept = tuple(row for row in edits.splits if not rows.start <= row < rows.stop)
    return replace(edits, splits=kept)


def parse_stretches(key: str, text: str, rows: int) -> tuple[Stretch, ...]:
    """Return the stretches that a user typed, in rows from 1 and with the last row.

    >>> parse_stretches("drop", "7,120-180,2600-", 2700)
    ((6, 7), (119, 180), (2599, 2700))

    Raises:
        UsageError: names the key, what was typed and the remedy.
    """
    mask = np.zeros(rows, bool)
    for word in map(str.strip, text[:MOST_TEXT].split(",")):
        typed = _TYPED.fullmatch(word)
        if not typed:
            raise UsageError(
                f"{key}={word[:40]}: no stretch of rows; write FIRST-LAST, such as 120-180, "
                "with commas between several"
            )
        first = int(typed["first"])
        last = int(typed["last"] or (rows if typed["dash"] else first))
        if not 1 <= first <= last <= rows:
            raise UsageError(f"{key}={word}: must be rows in 1..{rows}, the smaller first")
        mask[first - 1 : last] = True
    return true_runs(mask)


def format_stretches(stretches: Iterable[Stretch]) -> str:
    """Return stretches as a user types them.

    >>> format_stretches([(6, 7), (119, 180)])
    '7,120-180'
    """
    return ",".join(
        f"{first + 1}-{end}" if end - first > 1 else f"{end}" for first, end in stretches
    )


def typed_edits(
    rows: int,
    drop_text: str | None = None,
    keep_text: str | None = None,
    mirror_text: str | None = None,
    split_text: str | None = None,
) -> Edits:
    """Return the edits that the keys `drop`, `keep`, `mirror` and `split` name.

    Args:
        rows: number of rows of the recording.
        drop_text: stretches to leave out, see `parse_stretches`; None for none.
        keep_text: stretches to keep; all other rows are dropped; None for all.
        mirror_text: stretches to mirror.
        split_text: rows with which a further part begins, from 2.

    Raises:
        UsageError: a text is wrong.
    """

    def mask(key: str, text: str | None) -> np.ndarray:
        return _mask(parse_stretches(key, text, rows) if text else (), rows)

    dropped = mask("drop", drop_text)
    if keep_text:
        dropped |= ~mask("keep", keep_text)
    edits = Edits(rows, true_runs(dropped), true_runs(mask("mirror", mirror_text)))
    for text in split_text.split(",") if split_text else ():
        if not re.fullmatch(r"\d{1,12}", text.strip()):
            raise UsageError(f"split={text.strip()[:40]}: no row; write its number, such as 1200")
        edits = split(edits, int(text) - 1)
    return edits


def edit_options(edits: Edits) -> list[str]:
    """Return the options by which `typed_edits` returns these edits again.

    >>> edit_options(Edits(9, dropped=((1, 3),), splits=(5,)))
    ['drop=2-3', 'split=6']
    """
    texts = {
        "drop": format_stretches(edits.dropped),
        "mirror": format_stretches(edits.mirrored),
        "split": ",".join(str(row + 1) for row in edits.splits),
    }
    return [f"{key}={text}" for key, text in texts.items() if text]


def _rows(edits: Edits, stretch: Stretch) -> slice:
    first, end = stretch
    if not 0 <= first < end <= edits.rows:
        raise UsageError(
            f"rows {first + 1} to {end}: must be in 1..{edits.rows}, the smaller first"
        )
    return slice(first, end)


def _mask(stretches: Iterable[Stretch], rows: int) -> np.ndarray:
    mask = np.zeros(rows, dtype=bool)
    for first, end in stretches:
        mask[first:end] = True
    return mask

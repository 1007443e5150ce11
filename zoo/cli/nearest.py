"""The hint for a typo: the nearest names that exist."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

SHOWN = 15  # names that a hint lists where none is near


def hint(word: str, known: Iterable[str], remedy: str = "") -> str:
    """Return which of the known names a typo is near to, else all of them or the remedy.

    The last part of a dotted name counts, too: `ofset` is near `data.offset`.

    >>> hint("lap", ["laps", "seeds"])
    'did you mean laps?'
    """
    names = list(known)
    by_tail = {name.rpartition(".")[2]: name for name in reversed(names)}
    near = difflib.get_close_matches(word, names, n=1, cutoff=0.6)
    tail = difflib.get_close_matches(word.rpartition(".")[2], list(by_tail), n=2, cutoff=0.7)
    near += [by_tail[name] for name in tail if by_tail[name] not in near]
    if near:
        return f"did you mean {' or '.join(near[:2])}?"
    if len(names) < SHOWN or not remedy:
        return f"there are {', '.join(names)}" if names else remedy or "there are none"
    return remedy

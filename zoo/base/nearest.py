"""Hint for a typo: the nearest existing names."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

SHOWN = 15  # most names that a hint lists if none is near


def hint(word: str, known: Iterable[str], remedy: str = "") -> str:
    """Return the known names nearest to a typo; without any, all names or the remedy.

    A name of the same letters is the nearest. The last part of a dotted name is compared, too:
    `ofset` is near `data.offset`.

    >>> hint("lap", ["laps", "seeds"])
    'did you mean laps?'
    >>> hint("modle", ["module", "model"])
    'did you mean model or module?'
    """
    names = list(known)
    by_tail = {name.rpartition(".")[2]: name for name in reversed(names)}
    near = [name for name in names if name != word and sorted(name) == sorted(word)][:1]
    near = near or difflib.get_close_matches(word, names, n=1, cutoff=0.6)
    tail = difflib.get_close_matches(word.rpartition(".")[2], list(by_tail), n=2, cutoff=0.7)
    near += [by_tail[name] for name in tail if by_tail[name] not in near]
    if near:
        return f"did you mean {' or '.join(near[:2])}?"
    if len(names) < SHOWN or not remedy:
        return f"available: {', '.join(names)}" if names else remedy or "none available"
    return remedy

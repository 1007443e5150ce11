"""Rows of a study's table, all as text, and their groups."""

from collections.abc import Iterable, Mapping, Sequence

Row = Mapping[str, str]
Rows = Sequence[Row]


def grouped(rows: Iterable[Row], keys: Sequence[str]) -> list[list[Row]]:
    """Return rows with the same values of some columns together, in the order of the first."""
    groups: dict[tuple[str, ...], list[Row]] = {}
    for row in rows:
        groups.setdefault(tuple(row[key] for key in keys), []).append(row)
    return list(groups.values())

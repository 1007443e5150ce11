"""Rows of a study's CSV file, all as text, and their groups."""

import csv
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

Row = Mapping[str, str]
Rows = Sequence[Row]


def grouped(rows: Iterable[Row], keys: Sequence[str]) -> list[list[Row]]:
    """Return rows with the same values of some columns together, in the order of the first."""
    groups: dict[tuple[str, ...], list[Row]] = {}
    for row in rows:
        groups.setdefault(tuple(row[key] for key in keys), []).append(row)
    return list(groups.values())


def read_csv(path: Path) -> list[dict[str, str]]:
    """Return the rows of a CSV file, all as text; none where it does not exist."""
    if not path.is_file():
        return []
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def write_csv(path: Path, rows: Sequence[Mapping[str, object]]) -> None:
    """Write rows with the same keys as a CSV file; the keys of the first are its header."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def merge(
    old: Rows, new: Rows, key: Sequence[str], same: Sequence[str] = (), sort: Sequence[str] = ()
) -> list[Row]:
    """Return rows with new ones in place of those with the same key, and further ones at the end.

    Args:
        old: rows of the file.
        new: rows that were measured, with values of any type.
        key: columns that tell rows apart.
        same: columns in which all rows must agree; others of `old` are left out.
        sort: columns by whose text the rows are sorted.
    """
    rows = {
        tuple(row[name] for name in key): row
        for row in old
        if all(row[name] == str(new[0][name]) for name in same)
    }
    rows |= {tuple(str(row[name]) for name in key): row for row in new}
    return sorted(rows.values(), key=lambda row: [str(row[name]) for name in sort])

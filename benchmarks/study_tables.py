"""The tables of a study: rows of its CSV file, and tables between two markers of a page."""

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path

from benchmarks.measuring import markdown_table, write_between
from benchmarks.study_cells import CELLS, CHOICES, LARGEST, NOT_MEASURED, TEXTS
from benchmarks.study_lines import Row, Rows, grouped


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


def table(spec: Mapping, rows: Rows) -> str:
    """Return a table of a study's YAML as Markdown, with what stands before and after it."""
    groups = grouped(rows, spec.get("group", []))
    for name in spec.get("choose", []):
        groups = CHOICES[name](groups)
    parts = [TEXTS[spec["before"]](rows)] if "before" in spec else []
    if "columns" in spec and not groups:
        parts.append(NOT_MEASURED)
    elif "columns" in spec:
        head = [column[0] for column in spec["columns"]]
        lines = [
            [CELLS[cell](group, *arguments) for _, cell, *arguments in spec["columns"]]
            for group in groups
        ]
        parts.append(markdown_table(head, lines, spec.get("left", 1)))
    if "after" in spec:
        parts.append(TEXTS[spec["after"]](rows))
    return "\n\n".join(parts)


def write_tables(specs: Sequence[Mapping], rows: Rows) -> list[Path]:
    """Write the tables of a study's YAML into their pages, and return the pages.

    A table with `each` is written for each value of that column, to the page that has its marker.
    """
    pages = []
    for spec in specs:
        shown = [
            row
            for row in rows
            if all(row[key] == value for key, value in spec.get("where", {}).items())
            and ("needs" not in spec or row[spec["needs"]])
        ]
        shown = LARGEST[spec["rows"]](shown) if "rows" in spec else shown
        if "each" not in spec:
            write_between(Path(spec["page"]), spec["marker"], table(spec, shown))
            pages.append(Path(spec["page"]))
            continue
        for group in grouped(shown, [spec["each"]]):
            marker = spec["marker"].format(**group[0])
            for page in sorted(Path().glob(spec["page"])):
                if f"<!-- {marker} -->" in page.read_text():
                    write_between(page, marker, table(spec, group))
                    pages.append(page)
    return list(dict.fromkeys(pages))

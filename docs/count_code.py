"""Count the lines of code, docstrings, comments and blanks of each room, tests apart.

`python docs/count_code.py` prints a table of the files that git tracks, as they are on the disk.
`python docs/count_code.py --write` writes it into docs/architecture.md.
"""

import ast
import subprocess
import sys
from collections import Counter
from pathlib import Path

from benchmarks.measuring import markdown_table, write_between

ROOT = Path(__file__).parents[1]
PAGE = Path(__file__).with_name("architecture.md")
COLUMNS = ("files", "code", "docstrings", "comments", "blank")
TESTS, TOTAL = "tests", "total without tests"
DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


def count_lines(text: str) -> Counter[str]:
    """Return the number of lines of each kind in a Python source."""
    inside: set[int] = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, DOCUMENTED) and ast.get_docstring(node) is not None:
            inside.update(range(node.body[0].lineno, node.body[0].end_lineno + 1))
    counts = Counter(files=1)
    for number, line in enumerate(text.splitlines(), 1):
        if number in inside:
            counts["docstrings"] += 1
        elif line.strip().startswith("#"):
            counts["comments"] += 1
        else:
            counts["code" if line.strip() else "blank"] += 1
    return counts


def count_rooms() -> dict[str, Counter[str]]:
    """Return the counts of the rooms, most code first, of the total and of the tests."""
    command = ["git", "ls-files", "*.py"]
    names = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    rooms: dict[str, Counter[str]] = {}
    for name in names.splitlines():
        if not (ROOT / name).is_file():  # deleted, and not committed yet
            continue
        parts = name.split("/")
        room = TESTS if parts[0] == TESTS else "/".join(parts[:2] if parts[2:] else parts[:1])
        counts = count_lines((ROOT / name).read_text(encoding="utf-8"))
        for key in {room, TESTS if room == TESTS else TOTAL}:
            rooms.setdefault(key, Counter()).update(counts)
    last = {key: rooms.pop(key) for key in (TOTAL, TESTS)}
    return dict(sorted(rooms.items(), key=lambda room: -room[1]["code"])) | last


def table() -> str:
    """Return the counts as a Markdown table."""
    rows = [
        [room, *(f"{counts[key]:,}" for key in COLUMNS)] for room, counts in count_rooms().items()
    ]
    return markdown_table(["room", *COLUMNS], rows)


if __name__ == "__main__":
    if "--write" in sys.argv[1:]:
        write_between(PAGE, "lines of code", table())
    else:
        print(table())

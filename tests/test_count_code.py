"""The table of lines of code in `docs/architecture.md`, which `docs/count_code.py` writes."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "docs"))
import count_code  # noqa: E402

SOURCE = '''"""A docstring
of two lines."""

# A comment.
NUMBER = 2


def double(x):
    """Double."""
    return NUMBER * x  # code
'''


def test_docstrings_comments_and_blanks_are_no_code() -> None:
    counts = count_code.count_lines(SOURCE)
    assert counts == {"files": 1, "docstrings": 3, "comments": 1, "code": 3, "blank": 3}


def test_the_pages_table_is_written_by_the_script() -> None:
    page = count_code.PAGE.read_text(encoding="utf-8")
    text = page.partition("<!-- lines of code -->")[2].partition("<!-- end of lines -->")[0]
    head, line, *rows, total, tests = text.strip().splitlines()
    assert [head, line] == count_code.table().splitlines()[:2]
    assert total.startswith(f"| {count_code.TOTAL} | ")
    assert tests.startswith(f"| {count_code.TESTS} | ")
    cells = [[int(cell.replace(",", "")) for cell in row.split("|")[2:-1]] for row in rows]
    summed = [sum(column) for column in zip(*cells, strict=True)]
    assert summed == [int(cell.replace(",", "")) for cell in total.split("|")[2:-1]]


def test_the_script_prints_the_table() -> None:
    command = [sys.executable, ROOT / "docs" / "count_code.py"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.startswith("| room | files | code |")

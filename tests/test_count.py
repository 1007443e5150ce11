"""The lines of code and the words of the manual, which `docs/count.py` counts."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "docs"))
import count  # noqa: E402

SOURCE = '''"""A docstring
of two lines."""

# A comment.
NUMBER = 2


def double(x):
    """Double."""
    return NUMBER * x  # code
'''

PAGE = """# A heading

Three words [here](page.md). And `a=1` two!

<!-- runs -->
```console
drivezoo train
```

| a | table |
|---|---|

- An item
- Another
"""


def test_docstrings_comments_and_blanks_are_no_code() -> None:
    counts = count.count_lines(SOURCE)
    assert counts == {"files": 1, "docstrings": 3, "comments": 1, "code": 3, "blank": 3}


def test_the_pages_table_is_written_by_the_script() -> None:
    page = count.PAGE.read_text(encoding="utf-8")
    text = page.partition("<!-- lines of code -->")[2].partition("<!-- end of lines -->")[0]
    head, line, *rows, total, tests = text.strip().splitlines()
    assert [head, line] == count.tables()["lines of code"].splitlines()[:2]
    assert total.startswith(f"| {count.TOTAL} | ")
    assert tests.startswith(f"| {count.TESTS} | ")
    cells = [[int(cell.replace(",", "")) for cell in row.split("|")[2:-1]] for row in rows]
    summed = [sum(column) for column in zip(*cells, strict=True)]
    assert summed == [int(cell.replace(",", "")) for cell in total.split("|")[2:-1]]


def test_the_script_prints_both_tables() -> None:
    command = [sys.executable, ROOT / "docs" / "count.py"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.startswith("| room | files | code |")
    assert "\n| shelf | pages | words |" in done.stdout


def test_tables_code_and_comments_are_no_words(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(PAGE)
    assert count.count_words([page]) == [1, 11, 2]  # nine words in four sentences


def test_the_guide_is_read_in_an_hour() -> None:
    _, words, per_sentence = count.count_words(count.shelves()["Guide"])
    assert words <= 6_000
    assert per_sentence <= 16
